//! `coordinator render`: a scene file to a picture file.

use std::future::Future;
use std::sync::Arc;
use std::time::{Duration, Instant};

use coordinator::{Farm, Goal, Pixels, Progress, RenderError, RenderJob, Rendered, SceneSource, Unfinished};
use tessera_core::film::file::{Output, write_text};
use tessera_core::film::{ErrorEstimate, PixelsRef, pixels_sha256};
use tessera_core::settings::{Detail, Quality};
use tessera_core::trace::PreparedScene;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tracing::info;

use super::args::{ProgressArg, Render};
use super::console::Console;
use super::describe::Description;
use super::exit::{Exit, Failure};
use super::options::{Accuracy, Options, ReportTo, resolve};
use super::report::{Phases, Report};
use super::{progress, scene, signals};

/// Renders as the flags say; `began` is when the program started.
pub(crate) fn run(raw: Render, console: &Console, began: Instant) -> Result<Exit, Failure> {
    let options = Options::new(raw)?;
    for note in &options.notes {
        console.warning(note);
    }
    on_runtime(options.threads, render(Arc::new(options), console, began))
}

/// Runs `work` to its end, on a new runtime.
pub(super) fn on_runtime<T>(threads: usize, work: impl Future<Output = Result<T, Failure>>) -> Result<T, Failure> {
    let internal = |e: &dyn std::fmt::Display| Failure::new(Exit::Failed, format!("cannot start threads: {e}"));
    // Reading and building keep to the threads the user allows, as rendering does.
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().map_err(|e| internal(&e))?;
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().map_err(|e| internal(&e))?;
    let done = runtime.block_on(work);
    // What may still run (a scene half read when a signal came) is not waited for.
    runtime.shutdown_background();
    done
}

async fn render(options: Arc<Options>, console: &Console, began: Instant) -> Result<Exit, Failure> {
    let stop = signals::stop_on_signal(console);
    let mut farm = bind(&options, console).await?;
    // They connect while the scene is read.
    farm.hire(options.workers, options.threads);

    let mut phases = Phases::default();
    let reading = Instant::now();
    let path = options.scene.clone();
    let read = unless_stopped(&stop, blocking(move || scene::read(&path))).await??;
    phases.read = reading.elapsed();
    info!(seconds = phases.read.as_secs_f64(), "scene read");
    let scene = scene::accept(read, &options.scene, console)?;
    let description = options.report.is_some().then(|| Description::new(&options.scene.display().to_string(), &scene));

    let source = if options.workers > 0 {
        let building = Instant::now();
        let prepared = unless_stopped(&stop, blocking(move || PreparedScene::build(scene))).await??;
        phases.build = building.elapsed();
        info!(seconds = phases.build.as_secs_f64(), "structures built");
        SceneSource::Prepared(Arc::new(prepared))
    } else {
        SceneSource::Resolved(scene)
    };

    let job = RenderJob {
        region: options.region,
        pixels: options.pixels,
        tile: options.tile,
        workers: options.workers,
        threads: options.threads,
        goal: goal(&options, began),
        patience: options.patience,
        ..RenderJob::new(source, options.settings)
    };
    let last = job.scene.clone();
    let (tell, watched) = watch::channel(Progress::default());
    let shown = tokio::spawn(progress::show(progress::Style::of(options.progress), watched, console.clone()));
    let ended = farm.render(job, tell, stop).await;
    // A large scene takes a while to be given back: the picture is written meanwhile.
    rayon::spawn(move || drop(last));
    // It ends by itself, its sender being gone; the bar must be off the screen before the next line.
    let _ = shown.await;

    let (rendered, unfinished) = match ended {
        Ok(rendered) => (rendered, None),
        Err(Unfinished { error, partial }) => match partial.filter(|p| !p.done.is_empty()) {
            Some(partial) => (*partial, Some(error)),
            None => return Err(failure(&error)),
        },
    };
    let output = if unfinished.is_none() { options.output.clone() } else { options.output.partial() };
    let finish = {
        let (options, output) = (Arc::clone(&options), output.clone());
        move || finish(&options, &output, &rendered, description.as_ref(), phases, began).map(|()| rendered)
    };
    let rendered = blocking(finish).await??;
    let summary = summary(&output, &rendered, began);
    match unfinished {
        None => {
            let missed = missed(&options, &rendered);
            match options.progress {
                ProgressArg::None => {}
                // Whoever reads the lines of JSON reads them to the end.
                ProgressArg::Json => console.say(&progress::done_json(output.path(), began.elapsed())),
                _ => console.say(&summary),
            }
            match missed {
                Some(why) => Err(Failure::new(Exit::TargetMissed, why)),
                None => Ok(Exit::Done),
            }
        }
        Some(error) => {
            let mut failure = failure(&error);
            failure.message = format!("{}\n{summary}", failure.message);
            Err(failure)
        }
    }
}

/// The farm's goal. Writing the picture takes its share of a time limit.
fn goal(options: &Options, began: Instant) -> Goal {
    match options.accuracy {
        Accuracy::Samples => Goal::AsSet,
        Accuracy::Quality(quality) => Goal::Error(quality.rmse()),
        Accuracy::Error(error) => Goal::Error(error),
        Accuracy::Time { limit, error } => {
            let writing = Duration::from_millis(20) + Duration::from_nanos(80 * options.region.area());
            Goal::Time { limit: limit.saturating_sub(began.elapsed() + writing), error }
        }
    }
}

/// Why the accuracy asked for was not reached.
fn missed(options: &Options, rendered: &Rendered) -> Option<String> {
    let wanted = steps(options.accuracy.target()?);
    if rendered.target_met != Some(false) {
        return None;
    }
    let got = rendered.error.map_or_else(|| "not known".into(), |e| told(&e));
    Some(match options.accuracy {
        Accuracy::Time { limit, .. } if rendered.timed_out => {
            format!("time was up after {}: the error is {got}, not surely below {wanted}", progress::duration(limit))
        }
        _ => format!("the error asked for was not reached: it is {got}, not surely below {wanted}"),
    })
}

/// Listens before anything is read, so that a port in use costs no time.
async fn bind(options: &Options, console: &Console) -> Result<Farm, Failure> {
    let listen = match &options.listen {
        Some(text) => resolve(text).await?,
        None => coordinator::ListenAddr::Loopback,
    };
    let farm = Farm::bind(listen).await.map_err(|e| match &e {
        RenderError::Listen { source, .. } if source.kind() == std::io::ErrorKind::AddrInUse => Failure::new(
            Exit::Failed,
            format!("{e}; another program listens there: choose another port, or 0 for any free one"),
        ),
        _ => failure(&e),
    })?;
    if options.listen.is_some() || options.workers == 0 {
        console.say(&format!(
            "workers are awaited on {}; start them by: worker --connect HOST:{}",
            farm.addr(),
            farm.addr().port()
        ));
    }
    Ok(farm)
}

/// Runs `work` off the async threads.
pub(super) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, Failure> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|e| Failure::new(Exit::Failed, format!("internal error: {e}; please report it")))
}

/// What `work` gives, unless a signal comes first.
pub(super) async fn unless_stopped<T>(stop: &CancellationToken, work: impl Future<Output = T>) -> Result<T, Failure> {
    tokio::select! {
        done = work => Ok(done),
        () = stop.cancelled() => Err(Failure::new(Exit::Interrupted, "interrupted before anything was rendered")),
    }
}

/// Writes the picture and the report.
fn finish(
    options: &Options,
    output: &Output,
    rendered: &Rendered,
    description: Option<&Description>,
    mut phases: Phases,
    began: Instant,
) -> Result<(), Failure> {
    let writing = Instant::now();
    let pixels = match &rendered.image {
        Pixels::Rgb8(p) => PixelsRef::Rgb8(p),
        Pixels::Rgb16(p) => PixelsRef::Rgb16(p),
        Pixels::F32(p) => PixelsRef::F32(p),
    };
    let failed = |e: &dyn std::fmt::Display| Failure::new(Exit::Failed, e);
    let write = || {
        let written = output.write(rendered.region.width(), rendered.region.height(), pixels);
        (written, writing.elapsed())
    };
    // The report's hash takes about as long as the picture's file.
    let hash = || match (&options.report, pixels) {
        (Some(_), PixelsRef::F32(pixels)) => Some(pixels_sha256(pixels)),
        _ => None,
    };
    let ((written, took), pixels_sha256) = rayon::join(write, hash);
    written.map_err(|e| failed(&e))?;
    phases.write = took;
    info!(seconds = phases.write.as_secs_f64(), file = %output.path().display(), "picture written");
    let (Some(to), Some(description)) = (&options.report, description) else { return Ok(()) };
    let name = output.path().display().to_string();
    let report = Report::new(options, (name, pixels_sha256), description, rendered, &phases, began.elapsed());
    let text = report.to_text().map_err(|e| failed(&e))?;
    match to {
        ReportTo::Stdout => Console::new().out(&text)?,
        ReportTo::File(path) => write_text(path, &text).map_err(|e| failed(&e))?,
    }
    Ok(())
}

/// One line about what was written.
fn summary(output: &Output, rendered: &Rendered, began: Instant) -> String {
    let rays = rendered.rays.camera + rendered.rays.mirror + rendered.rays.shadow;
    let seconds = rendered.trace.as_secs_f64();
    let speed = if seconds > 0.0 { rays as f64 / seconds / 1e6 } else { 0.0 };
    let part = if rendered.is_complete() {
        String::new()
    } else {
        let done: u64 = rendered.done.iter().map(|r| r.area()).sum();
        format!(", {:.0} % of it", 100.0 * done as f64 / rendered.region.area() as f64)
    };
    let coarse = match rendered.pass.map(|p| p.detail) {
        Some(Detail::Coarse { step }) => format!(", coarse: a point in {step}x{step} pixels where time was up"),
        _ => String::new(),
    };
    let error = rendered.error.map_or_else(String::new, |e| format!("\nerror (RMSE): {}{}", told(&e), ahead(rendered)));
    format!(
        "{}: {}x{} pixels{part} in {}, {:.1} Mrays, {speed:.1} Mrays/s{coarse}{error}",
        output.path().display(),
        rendered.region.width(),
        rendered.region.height(),
        progress::duration(began.elapsed()),
        rays as f64 / 1e6,
    )
}

/// An error in 8-bit steps, with two digits or so.
fn steps(fraction: f64) -> String {
    let steps = 255.0 * fraction;
    match steps {
        s if !s.is_finite() => "not known".into(),
        s if s >= 9.95 => format!("{s:.0}"),
        s if s >= 0.995 => format!("{s:.1}"),
        s if s >= 0.0995 => format!("{s:.2}"),
        s if s >= 0.00095 || s == 0.0 => format!("{s:.3}"),
        s => format!("{s:.1e}"),
    }
}

/// An error and how sure it is.
fn told(error: &ErrorEstimate) -> String {
    let (low, high) = error.interval();
    if error.audited == 0 {
        return "not known".into();
    }
    format!("{} 8-bit steps, 95 % sure to lie in {} to {}", steps(error.rmse()), steps(low), steps(high))
}

/// What the next quality would take.
fn ahead(rendered: &Rendered) -> String {
    let Some((forecast, error)) = rendered.forecast.zip(rendered.error) else { return String::new() };
    let better = Quality::ALL.into_iter().find(|q| q.rmse() < 0.9 * error.rmse());
    let seconds = better.and_then(|q| Some((q, forecast.seconds(q.rmse())?)));
    seconds.map_or_else(String::new, |(quality, seconds)| {
        let time = Duration::try_from_secs_f64(seconds).map_or_else(|_| "years".into(), progress::duration);
        format!("; --quality {} ({}) would take about {time}", quality.name(), steps(quality.rmse()))
    })
}

/// How `error` ends the program.
pub(super) fn failure(error: &RenderError) -> Failure {
    let exit = match error {
        RenderError::NoWorkers { .. } => Exit::NoWorkers,
        RenderError::Prepare(_) | RenderError::Region(_) => Exit::Usage,
        RenderError::Cancelled => return Failure::new(Exit::Interrupted, "interrupted"),
        RenderError::Listen { .. } | RenderError::Tile { .. } | RenderError::Memory(_) | RenderError::Internal(_) => {
            Exit::Failed
        }
    };
    let remedy = match error {
        RenderError::NoWorkers { ever: false, .. } => {
            "; start workers by 'worker --connect HOST:PORT', or let this machine help with --workers N"
        }
        _ => "",
    };
    Failure::new(exit, format!("{error}{remedy}"))
}
