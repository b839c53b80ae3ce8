//! What being exact costs: instructions of scenes that people make exactly, beside the same a hair apart.
//!
//! `cargo bench -p tessera-tests --bench cliffs` counts both by callgrind and fails where a scene takes more than
//! its limit of times as much, or a fifth more than `cliffs.txt` beside this file says; with `-- --write` it writes
//! that file anew. The tracer without vectors has other instructions, so it is AVX2's that are counted. Where
//! valgrind does not run it says so and ends well.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use tessera_core::film::Region;
use tessera_core::simd::Level;
use tessera_core::trace::{PreparedScene, Refinement, Tracer};
use tessera_tests::callgrind::{alone, count, level};
use tessera_tests::generate::Document;
use tessera_tests::generate::cliff::{Cliff, cliffs};
use tessera_tests::subject::settings;

/// Ratios may be this much above what is on record.
const TOLERANCE: f64 = 0.2;

/// Those with more of the same say more.
fn counted(cliff: &Cliff) -> bool {
    !cliff.name.ends_with("-10") && !cliff.name.ends_with("-100")
}

fn trace(document: &Document, refinement: Refinement) {
    let scene = Arc::new(document.scene().expect("the scene is valid"));
    let prepared = Arc::new(PreparedScene::build(scene));
    let tracer = Tracer::new(prepared, settings(64, 48)).expect("settings are in range").with_refinement(refinement);
    let region = Region::new(0, 0, 64, 48).expect("not empty");
    let (tile, _) = alone(|| tracer.render(region));
    assert_eq!(tile.pixels.len(), 64 * 48);
}

/// Renders one of the two scenes of a cliff: its name, with or without `/apart`.
fn run(kernel: &str) {
    let (name, apart) = kernel.split_once('/').map_or((kernel, false), |(name, _)| (name, true));
    let cliff = cliffs().into_iter().find(|c| c.name == name).unwrap_or_else(|| panic!("no cliff '{name}'"));
    match (apart, &cliff.apart) {
        (false, _) => trace(&cliff.exact, Refinement::On),
        (true, Some(document)) => trace(document, Refinement::On),
        (true, None) => trace(&cliff.exact, Refinement::Off),
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
    if level() != Some(format!("{:?}", Level::Avx2)) {
        println!("valgrind does not run here, or offers no AVX2: nothing is counted");
        return ExitCode::SUCCESS;
    }
    let record = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/cliffs.txt");
    let before: BTreeMap<String, f64> = std::fs::read_to_string(&record)
        .unwrap_or_default()
        .lines()
        .filter_map(|l| l.split_once(' ').and_then(|(k, n)| Some((k.to_owned(), n.trim().parse().ok()?))))
        .collect();
    let (mut table, mut good) = (String::new(), true);
    for cliff in cliffs().iter().filter(|c| counted(c)) {
        let (exact, apart) = match (count(&cliff.name), count(&format!("{}/apart", cliff.name))) {
            (Ok(exact), Ok(apart)) => (exact, apart),
            (Err(e), _) | (_, Err(e)) => {
                eprintln!("{e}");
                return ExitCode::FAILURE;
            }
        };
        let now = exact as f64 / apart as f64;
        let _ = writeln!(table, "{} {now:.2}", cliff.name);
        let verdict = match before.get(&cliff.name) {
            _ if now > cliff.limit => "  beyond its limit",
            None => "  not on record",
            Some(before) if now > before * (1.0 + TOLERANCE) => "  too many",
            Some(_) => "",
        };
        println!("{:16} {now:6.2} of at most {:.1}{verdict}", cliff.name, cliff.limit);
        good &= verdict.is_empty();
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
