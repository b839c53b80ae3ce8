//! Accuracy by name, by target and by time, as users of the command see it.

use std::path::Path;

use serde_json::Value;
use tempfile::{TempDir, tempdir};
use tessera_tests::program::{Ended, run, scene};

/// Renders demo.xml small, with a report on stdout.
fn demo(at: &TempDir, arguments: &str) -> Ended {
    let path = scene("demo.xml");
    let path = path.to_str().expect("the repository's path is text");
    let common = ["render", path, "--report", "-"];
    let size = if arguments.contains("--size") { "" } else { "--size 80x60" };
    run(at.path(), common.into_iter().chain(size.split_whitespace()).chain(arguments.split_whitespace()))
}

fn report(ended: &Ended) -> Value {
    serde_json::from_str(&ended.out).expect(&ended.err)
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

#[test]
fn a_normal_picture_is_the_default_and_has_two_names() {
    let at = tempdir().expect("a folder");
    let plain = report(&demo(&at, ""));
    for words in ["--quality normal", "--quality preview", "--max-error 0.5"] {
        assert_eq!(plain["pixels_sha256"], report(&demo(&at, words))["pixels_sha256"], "{words}");
    }
    assert_eq!((&plain["accuracy"]["quality"], &plain["accuracy"]["target_met"]), (&"normal".into(), &true.into()));
    assert_eq!(report(&demo(&at, "--samples 1"))["accuracy"]["method"], "uniform");
}

#[test]
fn better_qualities_are_dearer_and_say_so() {
    let at = tempdir().expect("a folder");
    let mut last: Option<(f64, f64)> = None;
    for (name, target) in [("draft", 2.0), ("normal", 0.5), ("final", 0.25), ("reference", 0.05)] {
        let ended = demo(&at, &format!("--quality {name}"));
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        let report = report(&ended);
        let accuracy = &report["accuracy"];
        assert_eq!((&accuracy["method"], &accuracy["quality"]), (&"adaptive".into(), &name.into()));
        let (rays, error) = (number(&report["rays"]["total"]), number(&accuracy["estimated_rmse_8bit_steps"]));
        assert!((255.0 * number(&accuracy["target"]) - target).abs() < 1e-9);
        assert!(error <= target && error > target / 3.0, "{name}: {error}");
        assert!(ended.err.contains("error (RMSE):"), "{}", ended.err);
        // What the next one would take is said, but there is none after the last.
        assert_eq!(ended.err.contains("would take about"), name != "reference", "{}", ended.err);
        if let Some((fewer, more)) = last {
            assert!(rays > fewer && error < more, "{name}: {rays} rays, {error}");
        }
        last = Some((rays, error));
    }
}

#[test]
fn errors_are_meant_in_steps_or_as_fractions_and_reported_with_their_interval() {
    let at = tempdir().expect("a folder");
    let (steps, fraction) = (report(&demo(&at, "--max-error 1")), report(&demo(&at, "--max-error 1/255")));
    assert_eq!(steps["pixels_sha256"], fraction["pixels_sha256"]);
    let accuracy = &steps["accuracy"];
    assert!((number(&accuracy["target"]) * 255.0 - 1.0).abs() < 1e-9);
    assert!(number(&accuracy["estimated_rmse_8bit_steps"]) <= 1.0);
    assert_eq!(accuracy["target_met"], true);
    let rmse = number(&accuracy["estimated_rmse"]);
    let (low, high) = (number(&accuracy["interval"][0]), number(&accuracy["interval"][1]));
    assert!(0.0 < low && low < rmse && rmse < high && high <= 1.0 / 255.0, "{accuracy}");
    assert!(number(&accuracy["audited_pixels"]) > 0.0 && number(&accuracy["expected_rmse"]) > 0.0);
    assert!(number(&accuracy["tolerance"]) > 0.0 && accuracy["coarse_step"].is_null());
}

#[test]
fn a_region_has_the_pixels_of_the_whole_towards_an_error_too() {
    let at = tempdir().expect("a folder");
    for (size, error) in [("80x60", "0.5"), ("320x240", "1")] {
        let words = |more: &str| format!("--size {size} --max-error {error} {more}");
        let whole = demo(&at, &words("-o whole.pfm"));
        let part = demo(&at, &words("-o part.pfm --region 17,9,64,41"));
        assert_eq!((whole.code, part.code), (Some(0), Some(0)), "{}{}", whole.err, part.err);
        let read = |name: &str| tessera_core::film::file::read(&at.path().join(name)).expect("a picture").image;
        let (whole, part) = (read("whole.pfm"), read("part.pfm"));
        for y in 0..part.height() {
            for x in 0..part.width() {
                let at = |image: &tessera_core::film::Image, x: u32, y: u32| {
                    image.pixels()[(y * image.width() + x) as usize].map(f32::to_bits)
                };
                assert_eq!(at(&part, x, y), at(&whole, 17 + x, 9 + y), "{size}: {x},{y}");
            }
        }
    }
}

#[test]
fn a_millisecond_gives_a_coarse_picture_that_is_whole_and_said_to_be_coarse() {
    let at = tempdir().expect("a folder");
    let ended = demo(&at, "-o coarse.pfm --size 200x150 --time-limit 1ms");
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.err.contains("coarse"), "{}", ended.err);
    let report = report(&ended);
    assert_eq!((&report["complete"], &report["accuracy"]["coarse_step"]), (&true.into(), &8.into()));
    assert!(number(&report["accuracy"]["interval"][1]) > 1.0 / 255.0);
    let image = tessera_core::film::file::read(&at.path().join("coarse.pfm")).expect("a picture").image;
    // Nothing of this scene is black.
    assert!(image.pixels().iter().all(|p| p.iter().sum::<f32>() > 0.0));
}

#[test]
fn scrambled_points_are_as_many_as_asked_for_and_elsewhere() {
    let at = tempdir().expect("a folder");
    let (grid, scrambled) = (report(&demo(&at, "--samples 4")), report(&demo(&at, "--samples 4 --pattern scrambled")));
    assert_eq!(
        (&grid["accuracy"]["pattern"], &scrambled["accuracy"]["pattern"]),
        (&"grid".into(), &"scrambled".into())
    );
    assert_eq!(grid["rays"]["camera"], scrambled["rays"]["camera"]);
    assert_ne!(grid["pixels_sha256"], scrambled["pixels_sha256"]);
    let five = report(&demo(&at, "--samples 5 --pattern scrambled"));
    assert_eq!(five["rays"]["camera"], 5 * 80 * 60);
}

#[test]
fn a_target_that_cannot_be_reached_is_exit_5_and_a_picture() {
    let at = tempdir().expect("a folder");
    // No pixel gets so many points.
    let ended = demo(&at, "-o far.png --size 16x12 --max-error 0.0001");
    assert_eq!(ended.code, Some(5), "{}", ended.err);
    assert!(ended.err.contains("was not reached"), "{}", ended.err);
    assert!(at.path().join("far.png").exists());
    assert_eq!(report(&ended)["accuracy"]["target_met"], false);
}

#[test]
fn a_target_missed_for_want_of_time_is_exit_5_and_a_picture() {
    let at = tempdir().expect("a folder");
    let ended = demo(&at, "-o late.png --size 1200x900 --max-error 0.00001 --time-limit 1500ms");
    assert_eq!(ended.code, Some(5), "{}", ended.err);
    assert!(ended.err.contains("time was up"), "{}", ended.err);
    assert!(at.path().join(Path::new("late.png")).exists());
    assert_eq!(report(&ended)["accuracy"]["target_met"], false);
}

#[test]
fn a_target_reached_in_time_is_success() {
    let at = tempdir().expect("a folder");
    let ended = demo(&at, "--max-error 20 --time-limit 1h");
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(report(&ended)["accuracy"]["target_met"], true);
}

#[test]
fn accuracies_that_contradict_each_other_are_refused() {
    let at = tempdir().expect("a folder");
    for flags in [
        "--samples 4 --max-error 1",
        "--samples 4 --time-limit 1s",
        "--quality draft --max-error 1",
        "--quality best",
        "--pattern scrambled",
        "--samples 5",
        "--samples 5000 --pattern scrambled",
        "--max-error 0",
        "--max-error -1",
        "--max-error 1/0",
        "--time-limit 0s",
        "--time-limit soon",
    ] {
        let ended = demo(&at, flags);
        assert_eq!(ended.code, Some(2), "{flags}: {}", ended.err);
    }
}
