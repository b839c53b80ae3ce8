//! What being exact costs: scenes that people make exactly, timed in turns with the same a hair apart.
//!
//! `cargo run --release -p tessera-tests --bin cliffs -- [NAME…]`: one thread, 320x240, one sample a pixel; the
//! least of some rounds.

use std::sync::Arc;
use std::time::Instant;

use tessera_core::film::Region;
use tessera_core::settings::Settings;
use tessera_core::trace::{PreparedScene, RayCounts, Refinement, Tracer};
use tessera_tests::generate::Document;
use tessera_tests::generate::cliff::{Cliff, cliffs};
use tessera_tests::subject::settings;

fn prepare(document: &Document, settings: Settings, refinement: Refinement) -> Result<Tracer, String> {
    let scene = document.scene().map_err(|e| e.to_string())?;
    let prepared = Arc::new(PreparedScene::build(Arc::new(scene)));
    Ok(Tracer::new(prepared, settings).map_err(|e| e.to_string())?.with_refinement(refinement))
}

/// Seconds of one picture, and its rays.
fn time(tracer: &Tracer) -> (f64, RayCounts) {
    let view = &tracer.settings().view;
    let Some(all) = Region::new(0, 0, view.width(), view.height()) else { return (0.0, RayCounts::default()) };
    let start = Instant::now();
    let (_, counts) = tracer.render(all);
    (start.elapsed().as_secs_f64(), counts)
}

fn measure(cliff: &Cliff, rounds: u32) -> Result<(), String> {
    let settings = Settings { max_depth: cliff.depth, ..settings(320, 240) };
    let exact = prepare(&cliff.exact, settings, Refinement::On)?;
    let apart = match &cliff.apart {
        Some(apart) => prepare(apart, settings, Refinement::On)?,
        None => prepare(&cliff.exact, settings, Refinement::Off)?,
    };
    let (mut least, mut counts) = ([f64::INFINITY; 2], [RayCounts::default(); 2]);
    for _ in 0..rounds {
        for (k, tracer) in [&exact, &apart].into_iter().enumerate() {
            let (seconds, rays) = time(tracer);
            (least[k], counts[k]) = (least[k].min(seconds), rays);
        }
    }
    let share = |c: &RayCounts| 100.0 * c.refined as f64 / c.total() as f64;
    let ratio = least[0] / least[1];
    println!(
        "{:16} {:9.2} ms {:9.2} ms {:8.2} x (at most {:.1}){} refined {:.3} % and {:.3} %, {} unresolved",
        cliff.name,
        1e3 * least[0],
        1e3 * least[1],
        ratio,
        cliff.limit,
        if ratio > cliff.limit { " TOO MUCH" } else { "" },
        share(&counts[0]),
        share(&counts[1]),
        counts[0].unresolved,
    );
    Ok(())
}

fn main() -> Result<(), String> {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let rounds = std::env::var("ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(5);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| e.to_string())?;
    pool.install(|| {
        let chosen = |c: &&Cliff| names.is_empty() || names.iter().any(|n| c.name.starts_with(n.as_str()));
        cliffs().iter().filter(chosen).try_for_each(|c| measure(c, rounds))
    })
}
