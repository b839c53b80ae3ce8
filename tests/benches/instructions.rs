//! Instructions that the hot kernels take, counted by callgrind: a guard where time is too noisy.
//!
//! `cargo bench -p tessera-tests --bench instructions` counts them and fails where a kernel
//! takes more than a tenth more than `instructions.txt` beside this file says; with `-- --write`
//! it writes that file anew. Valgrind knows AVX2 but not AVX-512, so it is AVX2's kernels that
//! are counted. Where valgrind does not run it says so and ends well.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use tessera_core::film::Region;
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_core::simd::Level;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_core::xml::{ReadOptions, read_bytes};
use tessera_tests::callgrind::{alone, count, level};
use tessera_tests::generate::{self, Document};

/// Counts may be this much above what is on record.
const TOLERANCE: f64 = 0.10;

const KERNELS: [&str; 7] = ["build", "demo", "lights", "mirrors", "read", "sphereflake", "terrain"];

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
        "terrain" => trace(&generate::terrain(32)),
        other => panic!("no kernel '{other}'"),
    }
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if let [first, kernel] = &args[..]
        && first == "--kernel"
    {
        run(kernel);
        return ExitCode::SUCCESS;
    }
    if args.iter().any(|a| a == "--level") {
        println!("{:?}", Level::best());
        return ExitCode::SUCCESS;
    }
    match level() {
        Some(level) if level == format!("{:?}", Level::Avx2) => {}
        Some(level) => {
            println!("valgrind offers {level} here: nothing is counted");
            return ExitCode::SUCCESS;
        }
        None => {
            println!("valgrind does not run here: nothing is counted");
            return ExitCode::SUCCESS;
        }
    }
    let record = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/instructions.txt");
    let before: BTreeMap<String, u64> = std::fs::read_to_string(&record)
        .unwrap_or_default()
        .lines()
        .filter_map(|l| l.split_once(' ').and_then(|(k, n)| Some((k.to_owned(), n.trim().parse().ok()?))))
        .collect();
    let (mut table, mut good) = (String::new(), true);
    for kernel in KERNELS {
        let now = match count(kernel) {
            Ok(now) => now,
            Err(e) => {
                eprintln!("{e}");
                return ExitCode::FAILURE;
            }
        };
        let _ = writeln!(table, "{kernel} {now}");
        let Some(&before) = before.get(kernel) else {
            println!("{kernel:12} {now:>12}  not on record");
            good = false;
            continue;
        };
        let change = now as f64 / before as f64 - 1.0;
        let verdict = if change > TOLERANCE { "  too many" } else { "" };
        println!("{kernel:12} {now:>12}  {:+6.1} %{verdict}", 100.0 * change);
        good &= change <= TOLERANCE;
    }
    if args.iter().any(|a| a == "--write") {
        return match std::fs::write(&record, table) {
            Ok(()) => ExitCode::SUCCESS,
            Err(e) => {
                eprintln!("{}: {e}", record.display());
                ExitCode::FAILURE
            }
        };
    }
    if good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
