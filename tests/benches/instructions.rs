//! Instructions that the hot kernels take, counted by callgrind: a guard where time is too noisy.
//!
//! `cargo bench -p tessera-tests --bench instructions` counts them and fails where a kernel
//! takes more than a tenth more than `instructions.txt` beside this file says; with `-- --write`
//! it writes that file anew (see [`bench`]).

use std::fmt::Write;
use std::process::ExitCode;
use std::sync::Arc;

use tessera_core::film::Region;
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_core::xml::{ReadOptions, read_bytes};
use tessera_tests::callgrind::{Record, alone, bench, count};
use tessera_tests::generate::{self, Document};

/// Counts may be this much above what is on record.
const TOLERANCE: f64 = 0.10;

const KERNELS: [&str; 8] = ["build", "demo", "lights", "mesh", "mirrors", "read", "sphereflake", "terrain"];

fn tracer(document: &Document) -> Tracer {
    let settings = Settings {
        view: View::new(64, 48, 1.0, 1.0).expect("a view"),
        max_depth: 6,
        sampling: Sampling::Uniform { grid: 1 },
        transfer: Transfer::Srgb,
    };
    let scene = Arc::new(document.scene().expect("the scene is valid"));
    Tracer::new(Arc::new(PreparedScene::build(scene)), settings).expect("settings are in range")
}

fn trace(document: &Document) {
    let tracer = tracer(document);
    let region = Region::new(0, 0, 64, 48).expect("not empty");
    let (tile, _) = alone(|| tracer.render(region));
    assert_eq!(tile.pixels.len(), 64 * 48);
}

fn run(kernel: &str) {
    match kernel {
        "build" => {
            let scene = Arc::new(generate::terrain(16).scene().expect("the scene is valid"));
            alone(|| PreparedScene::build(scene));
        }
        "read" => {
            let text = generate::terrain(16).xml().into_bytes();
            alone(|| read_bytes(text, "terrain.xml", None, &ReadOptions::default())).expect("the scene is valid");
        }
        "demo" => trace(&generate::demo()),
        "mirrors" => trace(&generate::mirrors()),
        "lights" => trace(&generate::lights(100, 10)),
        "sphereflake" => trace(&generate::sphereflake(3)),
        "mesh" => trace(&generate::mesh_scene(generate::icosphere(4))),
        "terrain" => trace(&generate::terrain(32)),
        other => panic!("no kernel '{other}'"),
    }
}

/// Counts every kernel, and holds it against what is on record.
fn compare(record: &Record) -> Result<(String, bool), String> {
    let (mut table, mut good) = (String::new(), true);
    for kernel in KERNELS {
        let now = count(kernel)?;
        let _ = writeln!(table, "{kernel} {now}");
        let Some(&before) = record.get(kernel) else {
            println!("{kernel:12} {now:>12}  not on record");
            good = false;
            continue;
        };
        let change = now as f64 / before - 1.0;
        let verdict = if change > TOLERANCE { "  too many" } else { "" };
        println!("{kernel:12} {now:>12}  {:+6.1} %{verdict}", 100.0 * change);
        good &= change <= TOLERANCE;
    }
    Ok((table, good))
}

fn main() -> ExitCode {
    bench("instructions.txt", run, compare)
}
