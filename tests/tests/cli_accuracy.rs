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
fn a_final_picture_is_the_default() {
    let at = tempdir().expect("a folder");
    let (plain, asked) = (report(&demo(&at, "")), report(&demo(&at, "--quality final")));
    assert_eq!(plain["accuracy"]["quality"], "final");
    assert_eq!(plain["pixels_sha256"], asked["pixels_sha256"]);
    assert_eq!(report(&demo(&at, "--samples 1"))["accuracy"]["method"], "uniform");
}

#[test]
fn better_qualities_are_dearer_and_say_so() {
    let at = tempdir().expect("a folder");
    let mut last: Option<(f64, f64)> = None;
    for name in ["draft", "preview", "final", "reference"] {
        let ended = demo(&at, &format!("--quality {name}"));
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        let report = report(&ended);
        let accuracy = &report["accuracy"];
        assert_eq!((&accuracy["method"], &accuracy["quality"]), (&"adaptive".into(), &name.into()));
        let (rays, error) = (number(&report["rays"]["total"]), number(&accuracy["estimated_rmse"]));
        if let Some((fewer, more)) = last {
            assert!(rays > fewer && error < more, "{name}: {rays} rays, {error}");
        }
        last = Some((rays, error));
    }
}

#[test]
fn errors_are_meant_in_steps_or_as_fractions_and_reported_by_part() {
    let at = tempdir().expect("a folder");
    let (steps, fraction) = (report(&demo(&at, "--max-error 1")), report(&demo(&at, "--max-error 1/255")));
    assert_eq!(steps["pixels_sha256"], fraction["pixels_sha256"]);
    let accuracy = &steps["accuracy"];
    assert!((number(&accuracy["target"]) * 255.0 - 1.0).abs() < 1e-9);
    assert!(number(&accuracy["estimated_rmse_8bit_steps"]) <= 1.0);
    assert_eq!(accuracy["target_met"], true);
    let parts = &accuracy["parts"];
    let (samples, weight) = (number(&parts["samples_rmse"]), number(&parts["weight_rmse"]));
    let all = number(&accuracy["estimated_rmse"]);
    assert!((samples * samples + weight * weight - all * all).abs() < 1e-3 * all * all, "{accuracy}");
    assert!(number(&accuracy["estimated_worst_pixel"]) > all);
    // Shallower paths lose more.
    let shallow = report(&demo(&at, "--max-error 1 --max-depth 2"));
    assert!(number(&shallow["accuracy"]["parts"]["depth_bound"]) > number(&parts["depth_bound"]));
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
