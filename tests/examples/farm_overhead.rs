//! What the farm costs beside calling core directly: medians of interleaved runs.
//!
//! `cargo run --release -p tessera-tests --example farm_overhead [RUNS]`

use std::sync::Arc;
use std::time::{Duration, Instant};

use coordinator::{PixelFormat, SceneSource};
use tessera_core::scene::Scene;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::cluster::Cluster;
use tessera_tests::generate;

fn median(mut times: Vec<Duration>) -> f64 {
    times.sort();
    times[times.len() / 2].as_secs_f64() * 1e3
}

/// Processor time of this process so far, in milliseconds: where others keep the machine busy, it
/// tells more than the clock. 0 where there is no /proc.
fn cpu() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    // User and system time, in hundredths of a second.
    10.0 * fields.skip(11).take(2).filter_map(|f| f.parse::<f64>().ok()).sum::<f64>()
}

fn main() {
    let runs = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(9);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    let scene = |d: generate::Document| d.scene().expect("a valid scene");
    let scenes: [(&str, Scene, u32, u32); 4] = [
        ("demo 64x48", scene(generate::demo()), 64, 48),
        ("demo", scene(generate::demo()), 1280, 960),
        ("mirrors", scene(generate::mirrors()), 1280, 960),
        ("lights", scene(generate::lights(60, 12)), 1280, 960),
    ];
    println!(
        "{:12} {:>10} {:>10} {:>7} {:>6} {:>10} {:>8}",
        "", "core/ms", "farm/ms", "ratio", "tiles", "1 x 1/ms", "speed-up"
    );
    for (name, scene, width, height) in scenes {
        let mut cluster = Cluster::of(scene).size(width, height);
        cluster.job.pixels = PixelFormat::Rgb8;
        let prepared = Arc::new(PreparedScene::build(cluster.job.scene.scene().clone()));
        cluster.job.scene = SceneSource::Prepared(prepared.clone());
        let (mut core, mut farm, mut alone, mut tiles) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (mut core_cpu, mut farm_cpu) = (0.0, 0.0);
        for _ in 0..runs {
            let before = cpu();
            let start = Instant::now();
            pool.install(|| {
                let tracer = Tracer::new(prepared.clone(), cluster.job.settings).expect("settings in range");
                std::hint::black_box(tracer.render(cluster.job.region));
            });
            core.push(start.elapsed());
            let between = cpu();
            core_cpu += between - before;
            let start = Instant::now();
            let rendered = cluster.clone().workers(2, 1).render().expect("a picture");
            farm.push(start.elapsed());
            farm_cpu += cpu() - between;
            tiles.push(rendered.tiles);
            if width > 64 {
                alone.push(cluster.clone().workers(1, 1).render().expect("a picture").trace);
            }
        }
        let (core, farm) = (median(core), median(farm));
        tiles.sort_unstable();
        let tiles = tiles[tiles.len() / 2];
        let alone = if alone.is_empty() { f64::NAN } else { median(alone) };
        println!(
            "{name:12} {core:10.2} {farm:10.2} {:7.3} {:9.3} {tiles:6} {alone:10.2} {:8.2}",
            farm / core,
            farm_cpu / core_cpu,
            alone / farm
        );
    }
}
