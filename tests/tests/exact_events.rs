//! Exact events and numbers far apart, against an oracle of thousands of bits, at every level of instructions.

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;
use tessera_core::film::{Region, file};
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_core::simd::Level;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_core::xml::{ReadOptions, read_file};
use tessera_tests::compare::{Image, write_failure};
use tessera_tests::generate::event::{Kind, event};
use tessera_tests::oracle::Oracle;
use tessera_tests::subject::Subject;

/// Colours are values rounded to f32, of cosines that are known to less than this.
const CLOSE: f64 = 1e-4;

/// Scenes of each kind: enough to be quick; `EXACT_SEEDS` asks for more.
fn seeds() -> u64 {
    std::env::var("EXACT_SEEDS").ok().and_then(|n| n.parse().ok()).unwrap_or(12)
}

fn holds(kind: Kind, seed: u64) -> Result<(), String> {
    let (document, settings) = event(kind, seed);
    let Ok(scene) = document.scene() else { return Ok(()) };
    let expected = Oracle::new(&scene, kind.bits()).render(&settings).image;
    let subject = Subject::new(&document);
    let (pixels, counts) = subject.trace(&settings);
    let actual = Image { pixels: pixels.iter().map(|p| p.map(f64::from)).collect(), ..expected.clone() };
    let wrong = expected.pixels.iter().zip(&actual.pixels).filter(|(e, a)| {
        let scale = e.iter().fold(1.0, |m: f64, c| m.max(*c));
        !(0..3).all(|k| (e[k] - a[k]).abs() <= CLOSE * scale)
    });
    let wrong = wrong.count();
    if wrong > 0 {
        let at = write_failure(&format!("event-{kind:?}-{seed}"), &expected, &actual);
        let _ = document.write(&at, &format!("event-{kind:?}-{seed}"));
        return Err(format!("{kind:?} {seed}: {wrong} pixels are wrong, {} unresolved; see {at:?}", counts.unresolved));
    }
    if counts.unresolved > 0 && kind != Kind::Mirrors {
        return Err(format!("{kind:?} {seed}: {} samples are unresolved", counts.unresolved));
    }
    Ok(())
}

fn all_hold(kind: Kind) {
    let failed: Vec<_> = (0..seeds()).into_par_iter().filter_map(|seed| holds(kind, seed).err()).collect();
    assert!(failed.is_empty(), "{} of {}:\n{}", failed.len(), seeds(), failed.join("\n"));
}

#[test]
fn the_eye_on_surfaces() {
    all_hold(Kind::Contact);
}

#[test]
fn triangles_seen_from_their_edges() {
    all_hold(Kind::EdgeOn);
}

#[test]
fn needles_in_both_orders() {
    all_hold(Kind::Needles);
}

#[test]
fn lights_in_the_planes_of_walls() {
    all_hold(Kind::Walls);
}

/// Segments along a wall that holds the light would meet the edges of all that stands on it, each to be proven.
#[test]
fn a_light_in_a_walls_plane_leaves_next_to_nothing_to_be_proven() {
    let view = View::new(128, 96, 1.0, 1.0).expect("a view");
    let count = |seed| {
        let (document, settings) = event(Kind::Walls, seed);
        let (_, counts) = Subject::new(&document).trace(&Settings { view, ..settings });
        (counts.camera, counts.refined)
    };
    let counts: Vec<(u64, u64)> = (0..seeds()).into_par_iter().map(count).collect();
    let (samples, refined) = counts.iter().fold((0, 0), |sum, c| (sum.0 + c.0, sum.1 + c.1));
    assert!(10_000 * refined <= samples, "{refined} of {samples}");
}

#[test]
fn sizes_far_apart() {
    all_hold(Kind::Scales);
}

#[test]
fn the_ends_of_f64() {
    all_hold(Kind::Ends);
}

#[test]
fn pictures_near_poles_and_far_from_their_origins() {
    all_hold(Kind::Pictures);
}

#[test]
fn mirrors_that_touch() {
    all_hold(Kind::Mirrors);
}

#[test]
fn lattices_of_halves_leave_nothing_unresolved() {
    all_hold(Kind::Lattice);
}

#[test]
fn what_is_far_larger_than_what_is_seen_of_it() {
    all_hold(Kind::Giants);
}

#[test]
fn layers_in_one_exact_plane() {
    all_hold(Kind::Layers);
}

/// Scenes whose samples once were wrong, with the pictures that a second program made of them.
#[test]
fn samples_that_were_wrong_once_are_right() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/exact");
    let mut scenes: Vec<_> = std::fs::read_dir(&folder)
        .expect("the scenes are there")
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "xml"))
        .collect();
    scenes.sort();
    assert_eq!(scenes.len(), 20);
    for path in scenes {
        let expected = file::read(&path.with_extension("pfm")).expect("a picture").image;
        // One of them is about directions that hardly differ.
        let far = path.file_stem().is_some_and(|n| n == "16");
        let (zoom, height) = if far { (1e300, 1e-160) } else { (1.0, 1.0) };
        let (w, h) = (expected.width(), expected.height());
        let settings = Settings {
            view: View::new(w, h, zoom, height).expect("a view"),
            max_depth: 4,
            sampling: Sampling::Uniform { grid: 1 },
            transfer: Transfer::Linear,
        };
        let scene = read_file(&path, &ReadOptions::default()).expect("the scene is valid").scene;
        let prepared = Arc::new(PreparedScene::build(Arc::new(scene)));
        let tracer = Tracer::new(Arc::clone(&prepared), settings).expect("settings in range");
        let levels = Level::all().into_iter().map(|level| (format!("{level:?}"), tracer.clone().with_level(level)));
        for (level, tracer) in levels.chain([("f64".into(), tracer.clone().without_filter())]) {
            let (tile, counts) = tracer.render(Region::new(0, 0, w, h).expect("not empty"));
            assert_eq!(counts.unresolved, 0, "{path:?} by {level}");
            for (k, (a, e)) in tile.pixels.iter().zip(expected.pixels()).enumerate() {
                let close = (0..3).all(|c| (f64::from(a[c]) - f64::from(e[c])).abs() < CLOSE);
                assert!(close, "{path:?} by {level}: pixel {k} is {a:?}, not {e:?}");
            }
        }
    }
}
