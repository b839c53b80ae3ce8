//! Reads a scene and says how long it took and what came out.
//!
//! `cargo run --release -p tessera-core --example read_scene -- SCENE [THREADS]`

use std::path::Path;
use std::time::Instant;

use tessera_core::xml::{ReadOptions, read_file};

fn main() {
    let mut args = std::env::args().skip(1);
    let Some(path) = args.next() else {
        eprintln!("usage: read_scene SCENE [THREADS]");
        std::process::exit(2);
    };
    let threads = args.next().and_then(|t| t.parse().ok()).unwrap_or(0);
    if let Err(e) = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global() {
        eprintln!("{e}");
    }
    let begin = Instant::now();
    let result = read_file(Path::new(&path), &ReadOptions::default());
    let seconds = begin.elapsed().as_secs_f64();
    match result {
        Ok(read) => {
            println!("{} warnings", read.warnings.len() + read.omitted_warnings);
            let s = &read.scene;
            println!(
                "{} triangles, {} spheres, {} planes, {} lights, {} surfaces, {} pictures",
                s.triangles().len(),
                s.spheres().len(),
                s.planes().len(),
                s.lights().len(),
                s.surfaces().len(),
                s.pictures().len()
            );
        }
        Err(error) => println!("{error}"),
    }
    let peak = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = peak.lines().find(|l| l.starts_with("VmHWM")).unwrap_or("VmHWM: unknown");
    println!("read and checked in {seconds:.3} s, peak {peak}");
}
