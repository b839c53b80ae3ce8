//! `coordinator render` as its users and their scripts see it.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;
use sha2::{Digest, Sha256};
use tempfile::{TempDir, tempdir};
use tessera_core::film::encode;
use tessera_core::film::file::{Stored, read};
use tessera_core::settings::Transfer;
use tessera_tests::program::{Ended, Running, coordinator, run, scene};

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).expect("the folder is there");
    entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
}

fn set<const N: usize>(names: [&str; N]) -> BTreeSet<String> {
    names.map(String::from).into()
}

/// Renders demo.xml with these further arguments; `-o` is theirs to give.
fn demo(at: &TempDir, arguments: &str) -> Ended {
    let path = scene("demo.xml");
    let path = path.to_str().expect("the repository's path is text");
    run(at.path(), ["render", path].into_iter().chain(arguments.split_whitespace()))
}

fn picture(at: &TempDir, name: &str) -> Stored {
    read(&at.path().join(name)).expect(name)
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect(text)
}

#[test]
fn by_default_the_picture_bears_the_scenes_name() {
    let at = tempdir().expect("a folder");
    let ended = demo(&at, "");
    assert_eq!((ended.code, ended.out.as_str()), (Some(0), ""), "{}", ended.err);
    assert!(ended.err.starts_with("demo.png: 640x480 pixels"), "{}", ended.err);
    assert_eq!(names(at.path()), set(["demo.png"]));
    let image = picture(&at, "demo.png").image;
    assert_eq!((image.width(), image.height()), (640, 480));
}

#[test]
fn every_kind_of_file_holds_the_same_picture() {
    let at = tempdir().expect("a folder");
    for flags in [
        "-o a.pfm",
        "-o a.exr",
        "-o a8.png",
        "-o a16.png --bits 16",
        "-o a8.ppm --bits 8",
        "-o a16.ppm --bits 16",
        "-o l8.png --transfer linear",
        "-o l.pfm --transfer linear",
    ] {
        let ended = demo(&at, &format!("--size 61x37 --samples 4 {flags}"));
        assert_eq!(ended.code, Some(0), "{flags}: {}", ended.err);
    }
    let floats = picture(&at, "a.pfm");
    assert_eq!(floats, picture(&at, "a.exr"));
    let linear = floats.image.pixels();
    let eight: Vec<[f32; 3]> =
        encode::to_bytes(Transfer::Srgb, linear).iter().map(|p| p.map(|c| f32::from(c) / 255.0)).collect();
    let sixteen: Vec<[f32; 3]> =
        encode::to_words(Transfer::Srgb, linear).iter().map(|p| p.map(|c| f32::from(c) / 65535.0)).collect();
    for kind in ["png", "ppm"] {
        assert_eq!(picture(&at, &format!("a8.{kind}")).image.pixels(), eight);
        assert_eq!(picture(&at, &format!("a16.{kind}")).image.pixels(), sixteen);
    }
    let plain = picture(&at, "l8.png");
    assert_eq!(plain.transfer, Some(Transfer::Linear));
    let expected: Vec<[f32; 3]> = encode::to_bytes(Transfer::Linear, picture(&at, "l.pfm").image.pixels())
        .iter()
        .map(|p| p.map(|c| f32::from(c) / 255.0))
        .collect();
    assert_eq!(plain.image.pixels(), expected);
}

#[test]
fn a_region_is_that_part_of_the_whole() {
    let at = tempdir().expect("a folder");
    assert_eq!(demo(&at, "--size 80x60 -o whole.pfm").code, Some(0));
    assert_eq!(demo(&at, "--size 80x60 -o part.pfm --region 13,7,44,50 --tile 16").code, Some(0));
    let (whole, part) = (picture(&at, "whole.pfm").image, picture(&at, "part.pfm").image);
    assert_eq!((part.width(), part.height()), (31, 43));
    for (y, row) in part.pixels().chunks_exact(31).enumerate() {
        let from = (y + 7) * 80 + 13;
        assert_eq!(row, &whole.pixels()[from..from + 31], "row {y}");
    }
}

#[test]
fn the_report_has_the_keys_that_scripts_rely_on() {
    let at = tempdir().expect("a folder");
    let ended = demo(&at, "--size 64x48 -o a.pfm --report report.json --workers 2 --max-depth 3 --samples 1");
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(names(at.path()), set(["a.pfm", "report.json"]));
    let report = json(&std::fs::read_to_string(at.path().join("report.json")).expect("the report"));
    let seconds = |key: &str| report["seconds"][key].as_f64().expect(key);
    let parts: f64 = ["read", "build", "trace", "write"].map(seconds).iter().sum();
    assert!(parts > 0.0 && parts <= seconds("total"), "{report}");
    assert_eq!(report["rays"]["camera"], 64 * 48);
    assert_eq!(report["rays"]["unresolved"], 0);
    assert!(report["rays"]["mirror"].as_u64() > Some(0) && report["rays"]["shadow"].as_u64() > Some(0));
    // A worker that came when all was done is not in it.
    let workers = report["workers"].as_array().expect("the workers");
    assert!((1..=2).contains(&workers.len()), "{report}");
    assert_eq!(workers.iter().filter_map(|w| w["pixels"].as_u64()).sum::<u64>(), 64 * 48);
    assert_eq!((&report["scene"]["spheres"], &report["settings"]["max_depth"]), (&15.into(), &3.into()));
    assert!(report["accuracy"].is_object() && report["complete"] == true);
    // The hash is that of the rows from the top; the file has them from the bottom.
    let mut hash = Sha256::new();
    for x in picture(&at, "a.pfm").image.pixels().as_flattened() {
        hash.update(x.to_le_bytes());
    }
    let hash: String = hash.finalize().iter().map(|b| format!("{b:02x}")).collect();
    assert_eq!(report["pixels_sha256"], hash);
    // The same pixels whatever the file holds.
    let ended = demo(&at, "--size 64x48 -o a.png --report - --workers 1 --max-depth 3 --tile 8 --samples 1");
    assert_eq!(json(&ended.out)["pixels_sha256"], hash);
}

#[test]
fn progress_is_what_was_asked_for() {
    let at = tempdir().expect("a folder");
    let quiet = demo(&at, "--size 64x48 --progress none");
    assert_eq!((quiet.code, quiet.out.as_str(), quiet.err.as_str()), (Some(0), "", ""));
    let lines = demo(&at, "--size 64x48 --progress json");
    let events: Vec<Value> = lines.err.lines().map(json).collect();
    let [.., last, done] = &events[..] else { panic!("two lines at least: {}", lines.err) };
    assert_eq!((&last["event"], last["share"].as_f64()), (&"progress".into(), Some(1.0)));
    // At the end all of the last pass is done, and nothing was taken back.
    assert!(last["pixels_done"] == last["pixels_total"] && last["tiles_done"].as_u64() > Some(0), "{last}");
    assert!(events.iter().all(|e| e["event"] != "redone"), "{}", lines.err);
    assert_eq!((&done["event"], &done["output"]), (&"done".into(), &"demo.png".into()));
    // Nothing that only a terminal understands.
    for kind in ["auto", "plain", "bar", "json"] {
        let ended = demo(&at, &format!("--size 64x48 --progress {kind}"));
        assert!(ended.code == Some(0) && !ended.err.contains(['\x1b', '\r']), "{kind}: {:?}", ended.err);
    }
}

/// Starts a render that takes far longer than any test, and waits until part of it is done.
fn long_render(at: &TempDir) -> Running {
    let path = scene("demo.xml");
    let path = path.to_str().expect("the repository's path is text");
    let flags = ["render", path, "-o", "long.png", "--size", "4000x4000", "--samples", "1024", "--tile", "8"];
    let mut running = Running::start(coordinator(at.path(), flags).args(["--progress", "json"]));
    let some = running.line(|l| l.starts_with('{') && json(l)["tiles_done"].as_u64() > Some(0));
    assert!(some.is_some(), "the render ended early");
    running
}

#[cfg(unix)]
#[test]
fn an_interrupt_keeps_what_is_done_beside_the_target() {
    for signal in ["INT", "TERM"] {
        let at = tempdir().expect("a folder");
        let running = long_render(&at);
        running.signal(signal);
        let (status, said) = running.wait();
        assert_eq!(status.code(), Some(130), "{said}");
        assert!(said.contains("long.partial.png"), "{said}");
        assert_eq!(names(at.path()), set(["long.partial.png"]));
        let partial = picture(&at, "long.partial.png").image;
        assert_eq!((partial.width(), partial.height()), (4000, 4000));
        assert!(partial.pixels().iter().any(|p| p != &[0.0; 3]));
    }
}

#[cfg(unix)]
#[test]
fn an_interrupt_while_waiting_for_workers_leaves_nothing() {
    let at = tempdir().expect("a folder");
    let path = scene("demo.xml");
    let flags = ["render", path.to_str().expect("text"), "--listen", "127.0.0.1:0"];
    let mut running = Running::start(&mut coordinator(at.path(), flags));
    let line = running.line(|l| l.contains("workers are awaited")).expect("it says where it listens");
    assert!(line.contains("127.0.0.1:"), "{line}");
    running.signal("INT");
    let (status, said) = running.wait();
    assert_eq!(status.code(), Some(130), "{said}");
    assert_eq!(names(at.path()), set([]));
}
