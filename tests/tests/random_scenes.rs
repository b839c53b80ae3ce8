//! Whole random scenes at the limits, against the 512-bit oracle.

use std::ops::Range;

use tessera_core::settings::Settings;
use tessera_tests::compare::{assert_same_picture, difference};
use tessera_tests::generate::{Document, extreme};
use tessera_tests::subject::{Subject, colors, truth};

/// Renders the scenes of the seeds and demands that no pixel is wrong.
fn all_right(name: &str, seeds: Range<u64>, scene: impl Fn(u64) -> (Document, Settings)) {
    let (mut wrong, mut plain) = (Vec::new(), 0);
    for seed in seeds.clone() {
        let (document, settings) = scene(seed);
        if document.scene().is_err() {
            // Offsets may round the eye onto what it looks at.
            plain += 1;
            continue;
        }
        let subject = Subject::new(&document);
        let expected = truth(subject.scene(), &settings);
        let actual = subject.render(&settings);
        let d = difference(&expected, &actual);
        plain += u64::from(colors(&expected) < 8);
        if !d.wrong.is_empty() {
            println!("{name}, seed {seed}: {} wrong pixels, first {:?}", d.wrong.len(), d.wrong[0]);
            let _ = std::panic::catch_unwind(|| assert_same_picture(&format!("{name}-{seed}"), &expected, &actual));
            wrong.push(seed);
        }
    }
    let count = seeds.end - seeds.start;
    println!("{count} scenes, {plain} of them with little to see, {} wrong", wrong.len());
    assert!(wrong.is_empty(), "{name}: wrong pictures of seeds {wrong:?}");
    assert!(plain * 3 <= count, "{plain} of {count} scenes show hardly anything");
}

#[test]
fn fixed_seeds_are_right() {
    all_right("random", 0..60, |seed| extreme::random(seed, 32, 24));
}

#[test]
fn exact_events_are_right() {
    all_right("snapped", 0..80, extreme::snapped);
}

/// `TESSERA_SEEDS=first..end` chooses the scenes.
#[test]
#[ignore = "minutes to hours"]
fn many_seeds_are_right() {
    let range = std::env::var("TESSERA_SEEDS").unwrap_or_else(|_| "60..1060".into());
    let (a, b) = range.split_once("..").expect("TESSERA_SEEDS=first..end");
    let seeds = a.parse().unwrap()..b.parse().unwrap();
    all_right("snapped", seeds.clone(), extreme::snapped);
    all_right("random", seeds, |seed| extreme::random(seed, 64, 48));
}

/// How POV-Ray fares on the same scenes.
#[test]
#[ignore = "a measurement, for the record"]
fn peers_on_the_same_scenes() {
    if !tessera_tests::peers::povray_installed() {
        println!("skipped: povray is not installed");
        return;
    }
    let (mut right, mut count) = (0, 0);
    for seed in 0..60 {
        let (document, settings) = extreme::random(seed, 64, 48);
        let Ok(scene) = document.scene() else { continue };
        count += 1;
        let expected = truth(&scene, &settings).clamped();
        let folder = tempfile::tempdir().unwrap();
        let picture = tessera_tests::peers::povray(&scene, &settings, folder.path());
        let wrong = picture.map_or(usize::MAX, |p| difference(&expected, &p).wrong.len());
        right += u64::from(wrong == 0);
        println!("seed {seed}: {wrong} wrong pixels");
    }
    println!("POV-Ray has {right} of {count} right");
}
