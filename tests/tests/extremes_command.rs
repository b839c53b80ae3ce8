//! Whole pictures by `coordinator render`, from text to file, against the 512-bit oracle.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::path::Path;

use glam::{DVec3, dvec3};
use tessera_core::settings::{Settings, Transfer};
use tessera_tests::compare::{Image, assert_same_picture};
use tessera_tests::generate::contact::{KINDS, contact};
use tessera_tests::generate::extreme::{basic, random};
use tessera_tests::generate::{Document, Look};
use tessera_tests::program;
use tessera_tests::subject::{settings, truth};

/// Reads a little-endian colour PFM.
fn read_pfm(path: &Path) -> Image {
    let bytes = std::fs::read(path).unwrap();
    let mut ends = bytes.iter().enumerate().filter(|(_, b)| b.is_ascii_whitespace()).map(|(i, _)| i);
    let data = ends.nth(3).unwrap() + 1;
    let head = std::str::from_utf8(&bytes[..data]).unwrap();
    let mut words = head.split_whitespace();
    assert_eq!(words.next(), Some("PF"));
    let [width, height] = [(); 2].map(|()| words.next().unwrap().parse::<usize>().unwrap());
    assert!(words.next().unwrap().parse::<f64>().unwrap() < 0.0, "little-endian");
    let numbers: Vec<f64> =
        bytes[data..].chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
    assert_eq!(numbers.len(), 3 * width * height);
    // Rows from the bottom.
    let pixels = (0..width * height).map(|k| (height - 1 - k / width) * width + k % width);
    Image { width, height, pixels: pixels.map(|k| [0, 1, 2].map(|c| numbers[3 * k + c])).collect() }
}

#[track_caller]
fn assert_right_by_command(name: &str, document: &Document, settings: &Settings) {
    let folder = tempfile::tempdir().unwrap();
    document.write(folder.path(), "scene").unwrap();
    let view = &settings.view;
    let transfer = if settings.transfer == Transfer::Linear { "linear" } else { "srgb" };
    let ended = program::run(
        folder.path(),
        [
            "render".to_owned(),
            "scene.xml".to_owned(),
            "--output=out.pfm".to_owned(),
            "--samples=1".to_owned(),
            "--tile=16".to_owned(),
            format!("--size={}x{}", view.width(), view.height()),
            format!("--zoom={:e}", view.zoom()),
            format!("--max-depth={}", settings.max_depth),
            format!("--transfer={transfer}"),
        ],
    );
    assert_eq!(ended.code, Some(0), "{name}: {}", ended.err);
    let expected = truth(&document.scene().unwrap(), settings);
    assert_same_picture(&format!("command-{name}"), &expected, &read_pfm(&folder.path().join("out.pfm")));
}

#[test]
fn scales_and_offsets() {
    let s = settings(64, 48);
    for k in [-900, 900] {
        assert_right_by_command(&format!("scale-{k}"), &basic().scaled(2f64.powi(k)), &s);
    }
    assert_right_by_command("offset", &basic().moved(dvec3(1.0, -1.0, 1.0) * 2f64.powi(40)), &s);
    assert_right_by_command("rounded-offset", &basic().scaled(0.7).moved(dvec3(-0.6, 0.9, 0.3) * 2f64.powi(40)), &s);
}

#[test]
fn gaps_and_lights() {
    let d = Document::new(dvec3(0.0, 1.2, -3.5), dvec3(0.0, 0.4, 0.0))
        .with_background(0.2, 0.3, 0.5)
        .plane(DVec3::Y, 0.0, Look::new(0.8, 0.8, 0.8, 0.7, 0.3))
        .sphere(dvec3(-0.7, 0.5 + 1e-12, 0.0), 0.5, Look::new(0.9, 0.4, 0.3, 0.6, 0.4))
        .sphere(dvec3(0.3, 0.5, 0.0), 0.5 - 1e-12, Look::new(0.3, 0.4, 0.9, 0.6, 0.4))
        .triangle(
            [dvec3(-0.5, 1e-12, -1.5), dvec3(0.9, 1e-12, -1.4), dvec3(0.2, 1e-12, -0.6)],
            Look::matte(0.3, 0.9, 0.3),
        )
        .light(0.1, 1e-12, -1.6)
        .light(-2.0, 3.0, -2.0)
        .light(0.3, 1.0 + 1e-12, 0.0);
    assert_right_by_command("gaps", &d, &settings(64, 48));
}

#[test]
fn random_scenes() {
    for seed in [1, 2, 3, 5, 8, 13, 21, 34] {
        let (document, settings) = random(seed, 64, 48);
        assert_right_by_command(&format!("random-{seed}"), &document, &settings);
    }
}

#[test]
fn contacts() {
    for seed in 0..KINDS {
        let (document, settings) = contact(seed, 64, 48);
        assert_right_by_command(&format!("contact-{seed}"), &document, &settings);
    }
}

/// `TESSERA_SEEDS=first..end` chooses the scenes.
#[test]
#[ignore = "minutes to hours"]
fn many_scenes() {
    let range = std::env::var("TESSERA_SEEDS").unwrap_or_else(|_| "100..200".into());
    let (a, b) = range.split_once("..").unwrap();
    for seed in a.parse::<u64>().unwrap()..b.parse().unwrap() {
        for (name, (document, settings)) in [("random", random(seed, 64, 48)), ("contact", contact(seed, 64, 48))] {
            if document.scene().is_ok() {
                let start = std::time::Instant::now();
                assert_right_by_command(&format!("{name}-{seed}"), &document, &settings);
                println!("{name}-{seed}: {:?} with the oracle", start.elapsed());
            }
        }
    }
}
