//! What being exact costs: instructions of scenes that people make exactly, beside the same a hair apart.
//!
//! `cargo bench -p tessera-tests --bench cliffs` counts both by callgrind and fails where a scene takes a fifth more
//! than `cliffs.txt` beside this file says, or comes to take more than its limit; with `-- --write` it writes that file
//! anew (see [`bench`]). Limits are of times, which the program `cliffs` measures: a picture as small as can be counted
//! feels the first look at every plane, and what is on record beyond its limit for that is only said to be.

use std::fmt::Write;
use std::process::ExitCode;
use std::sync::Arc;

use tessera_core::film::Region;
use tessera_core::settings::Settings;
use tessera_core::trace::{PreparedScene, Refinement, Tracer};
use tessera_tests::callgrind::{Record, alone, bench, count};
use tessera_tests::generate::Document;
use tessera_tests::generate::cliff::{Cliff, cliffs};
use tessera_tests::subject::settings;

/// Ratios may be this much above what is on record.
const TOLERANCE: f64 = 0.2;

/// Those with more of the same say more.
fn counted(cliff: &Cliff) -> bool {
    !cliff.name.ends_with("-10") && !cliff.name.ends_with("-100")
}

fn trace(document: &Document, depth: u32, refinement: Refinement) {
    let scene = Arc::new(document.scene().expect("the scene is valid"));
    let prepared = Arc::new(PreparedScene::build(scene));
    let settings = Settings { max_depth: depth, ..settings(64, 48) };
    let tracer = Tracer::new(prepared, settings).expect("settings are in range").with_refinement(refinement);
    let region = Region::new(0, 0, 64, 48).expect("not empty");
    let (tile, _) = alone(|| tracer.render(region));
    assert_eq!(tile.pixels.len(), 64 * 48);
}

/// Renders one of the two scenes of a cliff: its name, with or without `/apart`.
fn run(kernel: &str) {
    let (name, apart) = kernel.split_once('/').map_or((kernel, false), |(name, _)| (name, true));
    let cliff = cliffs().into_iter().find(|c| c.name == name).unwrap_or_else(|| panic!("no cliff '{name}'"));
    match (apart, &cliff.apart) {
        (false, _) => trace(&cliff.exact, cliff.depth, Refinement::On),
        (true, Some(document)) => trace(document, cliff.depth, Refinement::On),
        (true, None) => trace(&cliff.exact, cliff.depth, Refinement::Off),
    }
}

/// Counts both scenes of every cliff, and holds their ratio against its limit and what is on record.
fn compare(record: &Record) -> Result<(String, bool), String> {
    let (mut table, mut good) = (String::new(), true);
    for cliff in cliffs().iter().filter(|c| counted(c)) {
        let now = count(&cliff.name)? as f64 / count(&format!("{}/apart", cliff.name))? as f64;
        let _ = writeln!(table, "{} {now:.2}", cliff.name);
        let (verdict, holds) = match record.get(&cliff.name) {
            None => ("  not on record", false),
            Some(before) if now > before * (1.0 + TOLERANCE) => ("  too many", false),
            Some(before) if now > cliff.limit => ("  beyond its limit", *before > cliff.limit),
            Some(_) => ("", true),
        };
        println!("{:16} {now:6.2} of at most {:.1}{verdict}", cliff.name, cliff.limit);
        good &= holds;
    }
    Ok((table, good))
}

fn main() -> ExitCode {
    bench("cliffs.txt", run, compare)
}
