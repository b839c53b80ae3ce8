//! What exactness costs: the same tracer with and without wide arithmetic.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use tessera_core::film::Region;
use tessera_core::settings::Settings;
use tessera_core::trace::{PreparedScene, RayCounts, Refinement, Tracer};

use crate::Result;
use crate::figures::{Figures, Series};
use crate::scenes::SceneFile;

/// Traces the scene in rounds, structures built, by core called directly: as it is, and with what
/// f64 leaves open left to f64.
///
/// # Errors
/// When the scene is not valid.
pub(crate) fn measure(file: &SceneFile, settings: &Settings, threads: u16, runs: u32) -> Result<Series> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build()?;
    let prepared = Arc::new(PreparedScene::build(Arc::new(file.read()?)));
    let [exact, plain] = [Refinement::On, Refinement::Off]
        .map(|r| Tracer::new(Arc::clone(&prepared), *settings).map(|t| t.with_refinement(r)));
    let (exact, plain) = (exact?, plain?);
    let whole = Region::new(0, 0, settings.view.width(), settings.view.height()).ok_or("an empty picture")?;
    let time = |tracer: &Tracer| -> (f64, RayCounts) {
        pool.install(|| {
            let start = Instant::now();
            let (tile, counts) = tracer.render(whole);
            let seconds = start.elapsed().as_secs_f64();
            black_box(tile);
            (seconds, counts)
        })
    };
    let mut series = Series::default();
    for round in 1..=runs {
        // Each goes first in every other round.
        let ((on, counts), (off, _)) = if round % 2 == 1 {
            (time(&exact), time(&plain))
        } else {
            let off = time(&plain);
            (time(&exact), off)
        };
        eprintln!("{} {round}/{runs}:  exact {on:.4} s  without {off:.4} s", file.name);
        let rays = (counts.camera + counts.mirror + counts.shadow) as f64;
        series.push(Figures::from([
            ("exact", on),
            ("plain", off),
            ("refined", counts.refined as f64 / rays),
            ("unresolved", counts.unresolved as f64),
        ]));
    }
    Ok(series)
}
