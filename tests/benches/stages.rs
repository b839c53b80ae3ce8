//! Every stage of a render by itself, on scenes made on the spot.
//!
//! `cargo bench -p tessera-tests --bench stages [FILTER]`. Rates are per ray, byte, object or
//! pixel, as the stage's own unit has it; one thread, but for the whole jobs.

use std::sync::Arc;

use divan::Bencher;
use divan::counter::{BytesCount, ItemsCount};
use glam::DVec3;
use tessera_core::film::{Region, encode};
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_core::simd::Level;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_core::xml::{ReadOptions, read_bytes};
use tessera_tests::cluster::Cluster;
use tessera_tests::generate::{self, Document, Random};

fn main() {
    // What a stage costs, not what the machine's threads make of it.
    if let Err(e) = rayon::ThreadPoolBuilder::new().num_threads(1).build_global() {
        eprintln!("{e}");
    }
    divan::main();
}

const SCENES: [&str; 5] = ["demo", "mirrors", "lights", "sphereflake", "terrain"];

fn document(name: &str) -> Document {
    match name {
        "demo" => generate::demo(),
        "mirrors" => generate::mirrors(),
        "lights" => generate::lights(200, 20),
        "sphereflake" => generate::sphereflake(4),
        _ => generate::terrain(64),
    }
}

fn prepared(name: &str) -> Arc<PreparedScene> {
    Arc::new(PreparedScene::build(Arc::new(document(name).scene().expect("the scene is valid"))))
}

fn settings(width: u32, height: u32) -> Settings {
    Settings {
        view: View::new(width, height, 1.0, 1.0).expect("a view"),
        max_depth: 6,
        sampling: Sampling::Uniform { grid: 1 },
        transfer: Transfer::Srgb,
    }
}

/// XML to a checked scene.
#[divan::bench(args = [16, 128])]
fn read(bencher: Bencher<'_, '_>, n: usize) {
    let text = generate::terrain(n).xml().into_bytes();
    bencher.counter(BytesCount::new(text.len())).with_inputs(|| text.clone()).bench_values(|text| {
        read_bytes(text, "terrain.xml", None, &ReadOptions::default()).expect("the scene is valid")
    });
}

/// A scene to what rays meet.
#[divan::bench(args = [16, 128])]
fn build(bencher: Bencher<'_, '_>, n: usize) {
    let scene = Arc::new(generate::terrain(n).scene().expect("the scene is valid"));
    bencher.counter(ItemsCount::new(scene.triangles().len())).bench(|| PreparedScene::build(Arc::clone(&scene)));
}

/// Rays from near the camera into the scene, and segments between points of it.
fn rays(name: &str) -> (Arc<PreparedScene>, Vec<(DVec3, DVec3)>) {
    let prepared = prepared(name);
    let mut random = Random::new(5);
    let at = prepared.scene().camera().location();
    let rays = (0..1000).map(|_| (at, prepared.scene().camera().look_at() + 2.0 * random.cube() - at)).collect();
    (prepared, rays)
}

/// One exact closest hit at a time, without packets.
#[divan::bench(args = SCENES)]
fn closest_hit(bencher: Bencher<'_, '_>, name: &str) {
    let (prepared, rays) = rays(name);
    bencher
        .counter(ItemsCount::new(rays.len()))
        .bench(|| rays.iter().filter(|(o, d)| prepared.closest_hit(*o, *d).is_some()).count());
}

/// One exact segment at a time, without packets.
#[divan::bench(args = SCENES)]
fn any_hit(bencher: Bencher<'_, '_>, name: &str) {
    let (prepared, rays) = rays(name);
    bencher
        .counter(ItemsCount::new(rays.len()))
        .bench(|| rays.iter().filter(|(o, d)| prepared.is_occluded(*o, *o + *d)).count());
}

/// A tile of 64 × 64 pixels in the middle of the picture.
fn tile(bencher: Bencher<'_, '_>, name: &str, level: Level) {
    let tracer = Tracer::new(prepared(name), settings(640, 480)).expect("settings are in range").with_level(level);
    let region = Region::new(288, 208, 352, 272).expect("not empty");
    let (_, counts) = tracer.render(region);
    bencher.counter(ItemsCount::new(counts.camera + counts.mirror + counts.shadow)).bench(|| tracer.render(region));
}

/// By the best instructions there are.
#[divan::bench(args = SCENES)]
fn tile_best(bencher: Bencher<'_, '_>, name: &str) {
    tile(bencher, name, Level::best());
}

/// By none but those that every machine has.
#[divan::bench(args = SCENES)]
fn tile_baseline(bencher: Bencher<'_, '_>, name: &str) {
    tile(bencher, name, Level::Baseline);
}

/// Linear pixels to 8-bit codes.
#[divan::bench]
fn codes(bencher: Bencher<'_, '_>) {
    let mut random = Random::new(3);
    let pixels: Vec<[f32; 3]> = (0..64 * 64).map(|_| [0; 3].map(|_| random.unit() as f32)).collect();
    bencher.counter(ItemsCount::new(pixels.len())).bench(|| encode::to_bytes(Transfer::Srgb, &pixels));
}

/// A whole farm of two workers, from nothing to the stitched picture.
#[divan::bench(args = ["demo", "terrain"], sample_count = 10)]
fn farm(bencher: Bencher<'_, '_>, name: &str) {
    bencher
        .counter(ItemsCount::new(320 * 240u32))
        .with_inputs(|| Cluster::of(document(name).scene().expect("the scene is valid")).size(320, 240))
        .bench_values(|cluster| cluster.workers(2, 1).render().map(|r| r.tiles).expect("the farm renders"));
}
