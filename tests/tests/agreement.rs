//! By others' eyes: the reference tracer, the tracer and POV-Ray show the same picture.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::sync::Arc;

use tessera_core::film::Region;
use tessera_core::scene::Scene;
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::compare::{Image, difference, write_failure};
use tessera_tests::generate::{self, Document};
use tessera_tests::judge::judge;
use tessera_tests::{peers, reference};

fn settings(width: u32, height: u32, transfer: Transfer) -> Settings {
    Settings {
        view: View::new(width, height, 1.0, 1.0).unwrap(),
        max_depth: 6,
        sampling: Sampling::Uniform { grid: 1 },
        transfer,
    }
}

fn traced(scene: &Scene, settings: Settings) -> Image {
    let prepared = Arc::new(PreparedScene::build(Arc::new(scene.clone())));
    let (w, h) = (settings.view.width(), settings.view.height());
    let (tile, _) = Tracer::new(prepared, settings).unwrap().render(Region::new(0, 0, w, h).unwrap());
    Image { width: w as usize, height: h as usize, pixels: tile.pixels.iter().map(|p| p.map(f64::from)).collect() }
}

/// POV-Ray's picture of the document, unless it is not installed.
fn by_povray(scene: &Scene, settings: &Settings) -> Option<Image> {
    if !judge("povray", &["--version"]) {
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    Some(peers::povray(scene, settings, folder.path()).unwrap())
}

fn close(name: &str, expected: &Image, actual: Image, rmse: f64, share: f64) {
    let actual = actual.clamped();
    let d = difference(expected, &actual);
    println!("{name}: rmse {:.5}, {:.3} % off, largest {:.3}", d.rmse, 100.0 * d.share_off, d.largest);
    if d.rmse > rmse || d.share_off > share {
        let at = write_failure(name, expected, &actual);
        panic!("{name}: rmse {}, share off {}; pictures in {at:?}", d.rmse, d.share_off);
    }
}

fn reference_agrees(name: &str, document: &Document, width: u32, height: u32, transfer: Transfer) {
    let (scene, settings) = (document.scene().unwrap(), settings(width, height, transfer));
    if let Some(expected) = by_povray(&scene, &settings) {
        close(&format!("reference-{name}"), &expected, reference::render(&scene, &settings), 0.003, 0.004);
    }
}

#[test]
fn reference_shows_demo_as_povray() {
    reference_agrees("demo", &generate::demo(), 640, 480, Transfer::Linear);
    reference_agrees("demo-srgb", &generate::demo(), 640, 480, Transfer::Srgb);
}

#[test]
fn reference_shows_mirrors_as_povray() {
    reference_agrees("mirrors", &generate::mirrors(), 640, 480, Transfer::Linear);
}

#[test]
fn reference_shows_sphereflake_as_povray() {
    reference_agrees("sphereflake2", &generate::sphereflake(2), 640, 480, Transfer::Linear);
}

#[test]
fn reference_shows_knot_as_povray() {
    reference_agrees("knot", &generate::knot_scene(64, 12), 320, 240, Transfer::Linear);
}

fn tracer_agrees(name: &str, document: &Document) {
    let (scene, settings) = (document.scene().unwrap(), settings(640, 480, Transfer::Linear));
    if let Some(expected) = by_povray(&scene, &settings) {
        close(&format!("tracer-{name}"), &expected, traced(&scene, settings), 0.002, 0.003);
    }
}

#[test]
fn tracer_shows_demo_as_povray() {
    tracer_agrees("demo", &generate::demo());
}

#[test]
fn tracer_shows_mirrors_as_povray() {
    tracer_agrees("mirrors", &generate::mirrors());
}

#[test]
fn tracer_shows_sphereflake4_as_povray() {
    tracer_agrees("sphereflake4", &generate::sphereflake(4));
}

#[test]
fn tracer_shows_terrain64_as_povray() {
    tracer_agrees("terrain64", &generate::terrain(64));
}

#[test]
fn tracer_shows_a_mesh_as_povray() {
    tracer_agrees("knot", &generate::knot_scene(185, 30));
}

/// A scanned mesh, where its file is beside the checkout.
#[test]
fn tracer_shows_a_scanned_mesh_as_povray() {
    match generate::read_ply(&generate::scans().join("dragon_vrip_res4.ply.gz")) {
        Some(mesh) => tracer_agrees("scan", &generate::mesh_scene(mesh)),
        None => println!("skipped: no scanned mesh in {:?}", generate::scans()),
    }
}
