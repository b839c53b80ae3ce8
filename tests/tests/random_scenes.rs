//! Whole random scenes at the limits, against the 512-bit oracle.

use std::ops::Range;
use std::time::{Duration, Instant};

use tessera_core::settings::Settings;
use tessera_tests::compare::{Image, assert_same_picture, difference};
use tessera_tests::generate::{Document, contact, extreme};
use tessera_tests::subject::{Subject, colors, truth};

/// Renders the scenes of the seeds and demands that no pixel is wrong.
fn all_right(name: &str, seeds: Range<u64>, scene: impl Fn(u64) -> (Document, Settings)) {
    let (mut wrong, mut plain) = (Vec::new(), 0);
    let (mut unresolved, mut slowest) = (0, (Duration::ZERO, 0));
    for seed in seeds.clone() {
        let (document, settings) = scene(seed);
        if document.scene().is_err() {
            // Offsets may round the eye onto what it looks at.
            plain += 1;
            continue;
        }
        let subject = Subject::new(&document);
        let expected = truth(subject.scene(), &settings);
        let start = Instant::now();
        let (pixels, counts) = subject.trace(&settings);
        slowest = slowest.max((start.elapsed(), seed));
        unresolved += counts.unresolved;
        let actual = Image { pixels: pixels.iter().map(|p| p.map(f64::from)).collect(), ..expected.clone() };
        let d = difference(&expected, &actual);
        plain += u64::from(colors(&expected) < 8);
        if !d.wrong.is_empty() {
            println!("{name}, seed {seed}: {} wrong pixels, first {:?}", d.wrong.len(), d.wrong[0]);
            let _ = std::panic::catch_unwind(|| assert_same_picture(&format!("{name}-{seed}"), &expected, &actual));
            wrong.push(seed);
        }
    }
    let count = seeds.end - seeds.start;
    println!(
        "{name}: {count} scenes, {plain} of them with little to see, {} wrong; {unresolved} samples left open by the \
         widest numbers; the slowest, of seed {}, took {:?} at all levels together",
        wrong.len(),
        slowest.1,
        slowest.0
    );
    assert!(wrong.is_empty(), "{name}: wrong pictures of seeds {wrong:?}");
    assert!(plain * 2 <= count, "{plain} of {count} scenes show hardly anything");
}

#[test]
fn fixed_seeds_are_right() {
    all_right("random", 0..60, |seed| extreme::random(seed, 32, 24));
}

#[test]
fn exact_events_are_right() {
    all_right("snapped", 0..80, extreme::snapped);
}

#[test]
fn the_smallest_before_the_largest_is_right() {
    // Whether a speck 10^-250 of its distance shadows another is a matter of 800 bits and more.
    all_right("sizes", 0..20, |seed| contact::contact(seed * contact::KINDS + contact::SIZES, 32, 24));
}

#[test]
fn contacts_are_right() {
    all_right("contact", 0..4 * contact::KINDS, |seed| contact::contact(seed, 32, 24));
}

/// `TESSERA_SEEDS=first..end` chooses the scenes.
#[test]
#[ignore = "minutes to hours"]
fn many_seeds_are_right() {
    let range = std::env::var("TESSERA_SEEDS").unwrap_or_else(|_| "60..1060".into());
    let (a, b) = range.split_once("..").expect("TESSERA_SEEDS=first..end");
    let seeds = a.parse().unwrap()..b.parse().unwrap();
    all_right("snapped", seeds.clone(), extreme::snapped);
    all_right("contact", seeds.clone(), |seed| contact::contact(seed, 64, 48));
    all_right("random", seeds, |seed| extreme::random(seed, 64, 48));
}
