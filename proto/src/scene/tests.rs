use glam::{DVec3, dvec3};
use proptest::prelude::*;
use tessera_core::scene::{Orientation, Pigment, PlanePosition, Scene, SceneBuilder, Surface, SurfaceId, Texture};

use super::{SceneDecoder, SceneEncoder, SceneError, describe};

fn encode(scene: &Scene, piece: usize) -> Vec<Vec<u8>> {
    SceneEncoder::new(scene, piece).map(|b| b.to_vec()).collect()
}

fn decode<'p>(pieces: impl IntoIterator<Item = &'p [u8]>, declared: u64) -> Result<Scene, SceneError> {
    let mut decoder = SceneDecoder::new(declared)?;
    for piece in pieces {
        decoder.push(piece)?;
    }
    decoder.finish()
}

fn builder() -> SceneBuilder {
    let mut b = SceneBuilder::new();
    b.camera(dvec3(0.0, 1.0, -5.0), DVec3::Y, DVec3::ZERO).unwrap();
    b.background([0.1, 0.2, 0.4]).unwrap();
    b
}

fn matte(builder: &mut SceneBuilder, red: f64) -> SurfaceId {
    builder.surface(Surface { diffuse: 0.5, reflect: 0.25, pigment: Pigment::Color([red, 0.5, 1.0]) }).unwrap()
}

/// Every kind of object, textures of both depths, kinds and surfaces changing often or not.
fn scene(plan: &[(u8, u8, f64)]) -> Scene {
    let mut b = builder();
    b.light(dvec3(1.0, 2.0, 3.0)).unwrap();
    let bytes = b.texture(Texture::from_bytes(3, 2, 200, (0..18).collect()).unwrap()).unwrap();
    let words = b.texture(Texture::from_words(2, 1, 1000, vec![0, 1, 999, 1000, 4, 5]).unwrap()).unwrap();
    let mut surfaces: Vec<_> = (0..3).map(|i| matte(&mut b, f64::from(i) / 4.0)).collect();
    for id in [bytes, words] {
        surfaces.push(b.surface(Surface { pigment: Pigment::Texture(id), ..Surface::default() }).unwrap());
    }
    for &(kind, surface, x) in plan {
        let s = surfaces[surface as usize % surfaces.len()];
        let at = dvec3(x, -x, 0.5);
        match kind % 6 {
            0 => b.plane(dvec3(0.0, 1.0, x), PlanePosition::Point(at), s),
            1 => b.plane(dvec3(0.0, 1.0, x), PlanePosition::Distance(x), s),
            2 => b.sphere(at, x.abs() + 1.0, None, s),
            3 => b.sphere(at, 2.0, Some(Orientation { pole: DVec3::Z, equator: dvec3(1.0, x, 0.0) }), s),
            4 => b.triangle([at, DVec3::X, DVec3::Y], s),
            _ => b.triangle_by_sides(at, [DVec3::X, DVec3::Y], s),
        }
        .unwrap();
    }
    b.finish().unwrap()
}

/// Every surface and texture used, so that encoding keeps all of them.
fn full_plan() -> Vec<(u8, u8, f64)> {
    (0..30).map(|i| (i % 6, i / 6, f64::from(i))).collect()
}

proptest! {
    #[test]
    fn what_arrives_is_what_was_sent(
        plan in prop::collection::vec((0u8..6, 0u8..5, -1e30..1e30f64), 0..60),
        piece in 1usize..5000,
        cut in 1usize..300,
    ) {
        let plan: Vec<_> = full_plan().into_iter().chain(plan).collect();
        let scene = scene(&plan);
        let whole = encode(&scene, piece).concat();
        let (_, length) = describe(&scene);
        prop_assert_eq!(length, whole.len() as u64);
        prop_assert_eq!(decode(whole.chunks(cut), length).unwrap(), scene);
    }

    #[test]
    fn damage_is_an_error_or_another_scene(byte in 0usize..2000, value: u8, length in 0usize..2000) {
        let whole = encode(&scene(&full_plan()), 1 << 16).concat();
        let mut damaged = whole.clone();
        let at = byte % whole.len();
        damaged[at] = value;
        let _ = decode(damaged.chunks(100), damaged.len() as u64);
        let short = &whole[..length % whole.len()];
        prop_assert!(decode([short], short.len() as u64).is_err());
        prop_assert!(decode([short], whole.len() as u64).is_err());
    }
}

#[test]
fn the_hash_is_of_the_content_and_not_of_the_pieces() {
    let scene = scene(&full_plan());
    assert_eq!(encode(&scene, 7).concat(), encode(&scene, 100_000).concat());
    assert_eq!(describe(&scene), describe(&scene.clone()));
    let other = self::scene(&full_plan()[1..]);
    assert_ne!(describe(&scene).0, describe(&other).0);
}

#[test]
fn only_textures_that_are_seen_travel() {
    let mut b = builder();
    let unused = b.texture(Texture::from_bytes(100, 100, 255, vec![7; 30_000]).unwrap()).unwrap();
    let used = b.texture(Texture::from_bytes(1, 1, 255, vec![1, 2, 3]).unwrap()).unwrap();
    b.surface(Surface { pigment: Pigment::Texture(unused), ..Surface::default() }).unwrap();
    let s = b.surface(Surface { pigment: Pigment::Texture(used), ..Surface::default() }).unwrap();
    b.sphere(DVec3::ZERO, 1.0, None, s).unwrap();
    let (_, length) = describe(&b.finish().unwrap());
    assert!(length < 500, "{length} bytes");
}

/// Eight bytes a number, and what a texture's samples take.
fn size_of_numbers(scene: &Scene) -> u64 {
    let surfaces: u64 =
        scene.surfaces().iter().map(|s| if matches!(s.pigment, Pigment::Color(_)) { 40 } else { 16 }).sum();
    let planes: u64 =
        scene.planes().iter().map(|p| if matches!(p.position, PlanePosition::Point(_)) { 48 } else { 32 }).sum();
    let textures: u64 = scene
        .textures()
        .iter()
        .map(|p| u64::from(p.width()) * u64::from(p.height()) * if p.bytes().is_some() { 3 } else { 6 })
        .sum();
    96 + 24 * scene.lights().len() as u64
        + surfaces
        + planes
        + textures
        + 32 * scene.spheres().len() as u64
        + 48 * scene.orientations().len() as u64
        + 72 * scene.triangles().len() as u64
}

#[test]
fn a_scene_takes_little_more_than_its_numbers() {
    let mut b = builder();
    let all_different: Vec<_> = (0..1000u32).map(|i| matte(&mut b, f64::from(i) / 1000.0)).collect();
    for (i, &s) in all_different.iter().enumerate() {
        let x = i as f64;
        match i % 3 {
            0 => b.sphere(dvec3(x, 0.0, 0.0), 1.0, None, s),
            1 => b.plane(dvec3(x, 1.0, 0.0), PlanePosition::Distance(x), s),
            _ => b.triangle([DVec3::X * x, DVec3::Y, DVec3::Z], s),
        }
        .unwrap();
    }
    let mut mesh = builder();
    let s = matte(&mut mesh, 0.5);
    for i in 0..10_000 {
        mesh.triangle([DVec3::X * f64::from(i), DVec3::Y, DVec3::Z], s).unwrap();
    }
    for scene in [b.finish().unwrap(), mesh.finish().unwrap(), scene(&full_plan()), scene(&full_plan()[..6])] {
        let (sent, own) = (describe(&scene).1, size_of_numbers(&scene));
        assert!(sent as f64 <= 1.2 * own as f64, "{sent} bytes for numbers of {own}");
    }
}

#[test]
fn counts_beyond_the_bytes_are_refused_before_memory_is_taken() {
    let mut bytes = b"TSRSCN01".to_vec();
    for _ in 0..6 {
        bytes.extend([0xff, 0xff, 0xff, 0xff, 0x0f]);
    }
    bytes.extend([0u8; 96]);
    assert_eq!(decode([&bytes[..]], 500), Err(SceneError::Counts(500)));
    assert_eq!(SceneDecoder::new(u64::MAX).unwrap_err(), SceneError::TooLong(u64::MAX));
    assert_eq!(decode([&b"GIF89a.."[..]], 8), Err(SceneError::Magic));
}
