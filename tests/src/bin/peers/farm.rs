//! What the farm costs beside core called directly, and what a second worker brings.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use coordinator::{ListenAddr, Progress, RenderJob, SceneSource};
use tessera_core::settings::Settings;
use tessera_core::trace::{PreparedScene, Tracer};
use tokio::runtime::Runtime;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use crate::Result;
use crate::figures::{Figures, Series};
use crate::scenes::SceneFile;

/// Renders the scene in rounds: by core with two threads, by two workers of one thread, by one.
///
/// The scene is prepared once for all, as the workers of one process share it.
///
/// # Errors
/// When the scene is not valid or a render fails.
pub(crate) fn measure(file: &SceneFile, settings: &Settings, runs: u32) -> Result<Series> {
    let prepared = Arc::new(PreparedScene::build(Arc::new(file.read()?)));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build()?;
    let mut series = Series::default();
    for round in 1..=runs {
        let core = core(&prepared, settings, &pool)?;
        let two = farm(&prepared, settings, 2)?;
        let one = farm(&prepared, settings, 1)?;
        let [core, two, one] = [core, two, one].map(|d| d.as_secs_f64());
        eprintln!("{} {round}/{runs}:  core {core:.3} s  farm of two {two:.3} s  of one {one:.3} s", file.name);
        series.push(Figures::from([("core", core), ("two", two), ("one", one)]));
    }
    Ok(series)
}

fn core(prepared: &Arc<PreparedScene>, settings: &Settings, pool: &rayon::ThreadPool) -> Result<Duration> {
    let start = Instant::now();
    let job = RenderJob::new(SceneSource::Prepared(prepared.clone()), *settings);
    pool.install(|| -> Result<()> {
        let tracer = Tracer::new(prepared.clone(), *settings)?;
        black_box(tracer.render(job.region));
        Ok(())
    })?;
    Ok(start.elapsed())
}

fn farm(prepared: &Arc<PreparedScene>, settings: &Settings, workers: usize) -> Result<Duration> {
    let start = Instant::now();
    let mut job = RenderJob::new(SceneSource::Prepared(prepared.clone()), *settings);
    (job.workers, job.threads) = (workers, workers);
    let progress = watch::Sender::new(Progress::default());
    let render = coordinator::render(job, ListenAddr::Loopback, progress, CancellationToken::new());
    black_box(Runtime::new()?.block_on(render)?);
    Ok(start.elapsed())
}
