//! The example scenes in `tests/scenes/` are what the generators write.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::path::{Path, PathBuf};

use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_tests::generate::{self, Document};
use tessera_tests::reference;

fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

/// With `TESSERA_WRITE_SCENES` set the file is rewritten, and the test fails so that it is seen.
fn is_current(name: &str, document: &Document) {
    let fresh = tempfile::tempdir().unwrap();
    document.write(fresh.path(), name).unwrap();
    let mut stale = Vec::new();
    for file in std::fs::read_dir(fresh.path()).unwrap() {
        let file = file.unwrap();
        let kept = scenes().join(file.file_name());
        let content = std::fs::read(file.path()).unwrap();
        if std::fs::read(&kept).ok().as_ref() != Some(&content) {
            stale.push(kept.clone());
            if std::env::var_os("TESSERA_WRITE_SCENES").is_some() {
                std::fs::create_dir_all(scenes()).unwrap();
                std::fs::write(&kept, &content).unwrap();
            }
        }
    }
    assert!(stale.is_empty(), "not as generated (TESSERA_WRITE_SCENES=1 rewrites): {stale:?}");
}

#[test]
fn demo() {
    is_current("demo", &generate::demo());
}

#[test]
fn mirrors() {
    is_current("mirrors", &generate::mirrors());
}

#[test]
fn sphereflake() {
    is_current("sphereflake2", &generate::sphereflake(2));
}

#[test]
fn terrain() {
    is_current("terrain8", &generate::terrain(8));
}

#[test]
fn lights() {
    is_current("lights", &generate::lights(60, 12));
}

#[test]
fn knot() {
    is_current("knot", &generate::knot_scene(48, 10));
}

/// Writes the scenes and how the reference tracer sees them to the folder in `TESSERA_GALLERY`.
#[test]
#[ignore = "a tool: writes the folder in TESSERA_GALLERY"]
fn gallery() {
    let folder = PathBuf::from(std::env::var_os("TESSERA_GALLERY").expect("TESSERA_GALLERY names a folder"));
    let settings = Settings {
        view: View::new(640, 480, 1.0, 1.0).unwrap(),
        max_depth: 6,
        sampling: Sampling::Uniform { grid: 2 },
        transfer: Transfer::Srgb,
    };
    for (name, document) in [
        ("demo", generate::demo()),
        ("mirrors", generate::mirrors()),
        ("sphereflake2", generate::sphereflake(2)),
        ("terrain8", generate::terrain(8)),
        ("lights", generate::lights(60, 12)),
        ("knot", generate::knot_scene(48, 10)),
    ] {
        document.write(&folder, name).unwrap();
        let picture = reference::render(&document.scene().unwrap(), &settings);
        std::fs::write(folder.join(format!("{name}.rendered.ppm")), picture.to_ppm()).unwrap();
    }
}
