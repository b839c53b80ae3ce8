//! `coordinator measure` as its users and their scripts see it.

use std::path::Path;

use serde_json::Value;
use tempfile::{TempDir, tempdir};
use tessera_core::film::file::read;
use tessera_tests::judge::judge;
use tessera_tests::program::{Ended, Running, coordinator, run, scene};

/// Small, with mirrors, shadows and a picture, and quick at any accuracy.
const SIZE: &str = "32x24";

fn demo() -> String {
    scene("demo.xml").to_str().expect("the repository's path is text").to_owned()
}

/// Measures demo.xml with these further arguments.
fn measure(at: &TempDir, arguments: &str) -> Ended {
    let path = demo();
    let all = ["measure", &path, "--size", SIZE].into_iter().chain(arguments.split_whitespace());
    run(at.path(), all)
}

fn render(at: &TempDir, arguments: &str) -> Ended {
    let path = demo();
    let all = ["render", &path, "--size", SIZE].into_iter().chain(arguments.split_whitespace());
    run(at.path(), all)
}

fn json(at: &Path) -> Value {
    let text = std::fs::read_to_string(at).expect("the file is there");
    serde_json::from_str(&text).expect("JSON")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

/// A reference of 400 samples a pixel, as `ref.pfm`.
fn reference(at: &TempDir) {
    assert_eq!(render(at, "--samples 400 -o ref.pfm").code, Some(0));
}

#[test]
fn the_curve_is_written_marked_and_told() {
    let at = tempdir().expect("a folder");
    let ended = measure(&at, "--budget none --repeat 1 --target 2 --reference-samples 256 --progress none");
    assert_eq!((ended.code, ended.err.as_str()), (Some(0), ""), "{}", ended.out);

    let result = json(&at.path().join("demo-curve.json"));
    assert_eq!((&result["complete"], &result["scene"], number(&result["target"])), (&true.into(), &"demo".into(), 2.0));
    assert_eq!((&result["settings"]["width"], &result["settings"]["workers"]), (&32.into(), &2.into()));
    assert_eq!(result["reference"]["samples_per_pixel"], 290);
    let own = number(&result["reference"]["own_rmse"]);
    assert!(own > 0.0 && own < 0.5, "{own}");

    let points = result["points"].as_array().expect("points");
    let of = |method: &str| points.iter().filter(|p| p["method"] == method).count();
    assert!(of("samples") >= 4 && of("scrambled") >= 4 && of("quality") == 4 && of("max-depth") >= 3, "{points:?}");
    // Of 16, 8, 4, 2, 1 and 0.5 steps two have names.
    assert_eq!(of("max-error"), 4);
    for p in points {
        for key in ["rmse", "largest", "share_beyond_255th", "share_beyond_510th", "ssim", "flip"] {
            assert!(p[key].as_f64().is_some_and(f64::is_finite), "{key} of {p}");
        }
        assert!(
            number(&p["seconds"]["whole"]) >= number(&p["seconds"]["trace"]) && number(&p["seconds"]["trace"]) > 0.0
        );
        assert!(number(&p["rays"]["total"]) >= number(&p["rays"]["camera"]));
        let uniform = p["method"] == "samples" || p["method"] == "scrambled";
        assert_eq!(p["predicted_rmse"].is_null(), uniform, "{p}");
    }
    // One point a pixel, and as many as it says.
    let samples = |n: &str| points.iter().find(|p| p["method"] == "samples" && p["setting"] == n).expect(n);
    assert_eq!((&samples("1")["rays"]["camera"], &samples("4")["rays"]["camera"]), (&768.into(), &3072.into()));
    assert!(number(&samples("4")["rmse"]) < number(&samples("1")["rmse"]));

    // The front, by its definition.
    let figures = |p: &Value| (number(&p["seconds"]["trace"]), number(&p["rmse"]));
    for p in points {
        let (s, e) = figures(p);
        let beaten = points.iter().map(figures).any(|(t, f)| t <= s && f <= e && (t < s || f < e));
        assert_eq!(p["pareto"], !beaten, "{p}");
    }

    let csv = std::fs::read_to_string(at.path().join("demo-curve.csv")).expect("a table");
    let lines: Vec<Vec<&str>> = csv.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!(lines.len(), points.len() + 1);
    let column = |name: &str| lines[0].iter().position(|n| *n == name).expect(name);
    for (line, p) in lines[1..].iter().zip(points) {
        assert_eq!(line.len(), lines[0].len());
        assert_eq!(line[column("setting")], p["setting"]);
        let rmse: f64 = line[column("rmse")].parse().expect("a number");
        assert!((rmse - number(&p["rmse"])).abs() <= 1e-12 * rmse, "{rmse} is not that of {p}");
    }

    let svg = std::fs::read_to_string(at.path().join("demo-curve.svg")).expect("a drawing");
    let document = roxmltree::Document::parse(&svg).expect("XML");
    let texts: Vec<&str> = document.descendants().filter(|n| n.has_tag_name("text")).filter_map(|n| n.text()).collect();
    for wanted in ["demo, 32×24: what accuracy costs", "final", "target 2", "--samples", "trace time, seconds"] {
        assert!(texts.contains(&wanted), "'{wanted}' is not among {texts:?}");
    }
    let png = read(&at.path().join("demo-curve.png")).expect("a picture").image;
    assert_eq!((png.width(), png.height()), (1920, 1240));
    assert!(png.pixels().iter().any(|p| *p != [1.0; 3]));

    // But for the command to be typed, which has the scene's path in it.
    let fits = |l: &str| l.chars().count() <= 80 || l.starts_with("  coordinator render ");
    assert!(ended.out.lines().all(fits), "{}", ended.out);
    for p in points {
        let mut lines = ended.out.lines().map(|l| l.split_whitespace().collect::<Vec<_>>());
        let told = |words: &Vec<&str>| {
            let at = words.iter().position(|w| p["method"] == *w);
            at.is_some_and(|i| words.get(i + 1).is_some_and(|w| p["setting"] == *w))
        };
        assert!(lines.any(|l| told(&l)), "{} {} is not in\n{}", p["method"], p["setting"], ended.out);
    }
}

#[test]
fn what_is_recommended_reaches_the_target() {
    let at = tempdir().expect("a folder");
    reference(&at);
    let ended = measure(&at, "--budget none --repeat 1 --target 3 --reference ref.pfm -o curves.json --progress none");
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let result = json(&at.path().join("curves.json"));
    let advice = &result["recommendation"];
    let command = advice["command"].as_str().expect("a command");
    assert!(ended.out.contains(command), "{command}");
    assert!(number(&advice["rmse"]) <= 3.0);
    let points = result["points"].as_array().expect("points");
    let cheaper =
        |p: &&Value| number(&p["rmse"]) <= 3.0 && number(&p["seconds"]["trace"]) < number(&advice["trace_seconds"]);
    assert_eq!(points.iter().find(cheaper), None);

    // As it would be typed, in its own words.
    let words: Vec<&str> = command.split_whitespace().collect();
    assert_eq!(words[0], "coordinator");
    let rendered = run(at.path(), words[1..].iter().copied().chain(["-o", "taken.pfm"]));
    assert_eq!(rendered.code, Some(0), "{}", rendered.err);
    let compared = run(at.path(), ["compare", "ref.pfm", "taken.pfm", "--tolerance", "3", "--json"]);
    assert_eq!(compared.code, Some(0), "{}", compared.out);
    let compared: Value = serde_json::from_str(&compared.out).expect("JSON");
    assert!((number(&compared["rmse"]) - number(&advice["rmse"])).abs() < 1e-6, "{compared}");
}

#[test]
fn what_can_be_known_to_fail_is_told_at_once() {
    let at = tempdir().expect("a folder");
    assert_eq!(render(&at, "--samples 1 -o small.png --region 0,0,20,20").code, Some(0));
    for (arguments, code, words) in [
        ("--reference small.png", 2, "'small.png' has 20x20 pixels, but 32x24 are rendered"),
        ("--reference none.pfm", 2, "'none.pfm' is no picture"),
        ("--reference small.png --reference-samples 9", 2, "cannot be used with"),
        ("-o none/curve", 2, "'none' does not exist"),
        ("--target 0", 2, "above 0"),
        ("--budget soon", 2, "'none'"),
        ("--workers 0", 2, "--workers"),
    ] {
        let ended = measure(&at, arguments);
        assert!(ended.code == Some(code) && ended.err.contains(words), "{arguments}: {ended:?}");
    }
    let path = demo();
    let lost = coordinator(at.path(), ["measure", &path, "--peers"]).env("PATH", at.path()).output();
    let lost = Ended::from(lost.expect("coordinator starts"));
    assert!(lost.code == Some(1) && lost.err.contains("POV-Ray is not installed"), "{lost:?}");
    std::fs::write(at.path().join("bad.xml"), "<scene/>").expect("written");
    assert_eq!(run(at.path(), ["measure", "bad.xml"]).code, Some(3));
    let names = std::fs::read_dir(at.path()).expect("a folder").count();
    assert_eq!(names, 2, "nothing but the two files made here");
}

#[test]
fn povray_is_measured_beside_us() {
    if !judge("povray", &["--version"]) {
        return;
    }
    let at = tempdir().expect("a folder");
    reference(&at);
    let ended = measure(&at, "--budget none --repeat 1 --reference ref.pfm --peers --progress none");
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let result = json(&at.path().join("demo-curve.json"));
    let points = result["points"].as_array().expect("points");
    let of = |method: &str| points.iter().filter(|p| p["method"] == method).collect::<Vec<_>>();
    let (ours, theirs) = (of("samples"), of("pov-ray"));
    assert_eq!(theirs.len(), 5);
    // One ray through every pixel's middle: the same picture by two programs, so the same error.
    let (a, b) = (number(&ours[0]["rmse"]), number(&theirs[0]["rmse"]));
    assert!((a / b - 1.0).abs() < 0.1, "{a} {b}");
    assert!(number(&theirs[4]["rmse"]) < 0.5 * b);
    assert!(theirs.iter().all(|p| p["recommended"] == false));
}

#[test]
fn an_interrupted_measurement_keeps_what_it_has() {
    let at = tempdir().expect("a folder");
    reference(&at);
    let path = demo();
    // Repeated so often that it will not end by itself.
    let arguments =
        ["measure", &path, "--size", SIZE, "--reference", "ref.pfm", "--repeat", "1000", "--progress", "json"];
    let mut running = Running::start(coordinator(at.path(), arguments).stdout(std::process::Stdio::null()));
    assert!(running.line(|l| l.contains("--samples 1")).is_some());
    running.signal("INT");
    let (status, said) = running.wait();
    assert_eq!(status.code(), Some(130), "{said}");
    let result = json(&at.path().join("demo-curve.json"));
    assert_eq!(result["complete"], false);
    assert!(at.path().join("demo-curve.csv").is_file());
}
