//! Beams against rays: whatever a ray clearly meets is among what its beam may meet, and what is said to be covered,
//! or proven, is.

use std::sync::Arc;

use glam::DVec3;
use proptest::prelude::*;

use super::cover::{Cover, Depth};
use super::gather::{Pyramid, Shaft, gather};
use super::lens::{EDGE, HALF, Lens, Tile};
use crate::film::PlanePoint;
use crate::integrate::{RayCounts, Sample, Tracer, WaveScratch};
use crate::sampling::points::{Sequence, centre, mix};
use crate::sampling::proof::prove;
use crate::scene::{Pigment, PlanePosition, SceneBuilder, Surface};
use crate::settings::{Sampling, Settings, Transfer, View};
use crate::shapes::beam::Figure;
use crate::shapes::{Kind, ObjectId, kind};
use crate::traverse::PreparedScene;

const SIZE: (u32, u32) = (64, 48);

/// Numbers that follow from a seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = mix(self.0, 1);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn within(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.next()
    }

    fn place(&mut self) -> DVec3 {
        let z = self.within(1.0, 8.0);
        DVec3::new(self.within(-0.8, 0.8) * z, self.within(-0.7, 0.7) * z, z)
    }

    fn direction(&mut self) -> DVec3 {
        DVec3::new(self.within(-1.0, 1.0), self.within(-1.0, 1.0), self.within(-1.0, 1.0))
    }
}

/// Balls, strips of triangles that share edges, slivers, planes and lights, from the eye at the origin along z.
fn scene(random: &mut Random, smooth: bool) -> Tracer {
    let mut builder = SceneBuilder::new();
    builder.camera(DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
    builder.background([0.9, 0.2, 0.1]).unwrap();
    let surface = |builder: &mut SceneBuilder, color: [f64; 3], reflect: f64| {
        builder.surface(Surface { diffuse: 1.0 - reflect, reflect, pigment: Pigment::Color(color) }).unwrap()
    };
    let colors = [[0.9, 0.1, 0.4], [0.1, 0.8, 0.9], [1.0, 1.0, 0.0], [0.3, 0.3, 1.0]];
    let mut surfaces: Vec<_> = colors.iter().map(|c| surface(&mut builder, *c, 0.0)).collect();
    if !smooth {
        surfaces.push(surface(&mut builder, [0.5; 3], 0.5));
    }
    let pick = |random: &mut Random| surfaces[(random.next() * surfaces.len() as f64) as usize];
    for _ in 0..(random.next() * 8.0) as usize {
        let radius = 0.01 * libm::pow(100.0, random.next());
        let (at, surface) = (random.place(), pick(random));
        builder.sphere(at, radius, None, surface).unwrap();
    }
    for _ in 0..(random.next() * 4.0) as usize {
        let surface = pick(random);
        let (mut a, mut b) = (random.place(), random.place());
        for _ in 0..1 + (random.next() * 4.0) as usize {
            let sliver = random.next() < 0.3;
            let c = if sliver { (a + b) * 0.5 + random.direction() * 1e-3 } else { random.place() };
            // Degenerate ones are refused.
            let _ = builder.triangle([a, b, c], surface);
            (a, b) = (b, c);
        }
    }
    for _ in 0..(random.next() * 2.5) as usize {
        let n = random.direction();
        let _ = builder.plane(n, PlanePosition::Point(random.place()), pick(random));
    }
    for _ in 0..1 + (random.next() * 2.0) as usize {
        let far = if smooth { 1e6 } else { 3.0 };
        builder.light(random.direction() * far).unwrap();
    }
    let view = View::new(SIZE.0, SIZE.1, 1.0, 1.0).unwrap();
    let settings = Settings { view, max_depth: 4, sampling: Sampling::Adaptive, transfer: Transfer::Linear };
    Tracer::new(Arc::new(PreparedScene::build(Arc::new(builder.finish().unwrap()))), settings).unwrap()
}

fn eye(tracer: &Tracer) -> Lens {
    let frame = tracer.frame();
    Lens { apex: DVec3::ZERO, forward: frame.forward, right: frame.right, up: frame.up }
}

fn ids(tracer: &Tracer) -> impl Iterator<Item = u32> {
    0..tracer.prepared().scene.object_count() as u32
}

/// Where a ray clearly meets an object, in units of its direction: `None` if it passes so close to an edge that it
/// cannot tell, `Some(None)` if it clearly passes by.
fn meets(tracer: &Tracer, id: u32, origin: DVec3, direction: DVec3) -> Option<Option<f64>> {
    const CLEAR: f64 = 1e-7;
    let prepared = tracer.prepared();
    match kind(&prepared.scene, ObjectId(id)) {
        (Kind::Plane, i) => {
            let (n, h) = (prepared.local.planes[i].n.to_dvec3(), prepared.local.planes[i].h);
            let (above, down) = (h - n.dot(origin), n.dot(direction));
            let unclear = above.abs() < CLEAR * (h.abs() + origin.length())
                || down.abs() < CLEAR * n.length() * direction.length();
            if unclear { None } else { Some(Some(above / down).filter(|t| *t > 0.0)) }
        }
        (Kind::Sphere, i) => {
            let s = &prepared.local.spheres[i];
            let to = s.center() - origin;
            let (a, b, c) = (direction.dot(direction), to.dot(direction), to.dot(to) - s.r * s.r);
            let root = b * b - a * c;
            if root.abs() < CLEAR * (b * b + a * to.dot(to)) || c.abs() < CLEAR * to.dot(to) {
                return None;
            }
            let t = if c > 0.0 { (b - root.max(0.0).sqrt()) / a } else { (b + root.max(0.0).sqrt()) / a };
            Some(Some(t).filter(|t| root > 0.0 && *t > 0.0))
        }
        (Kind::Triangle, i) => {
            let v = prepared.local.triangle(&prepared.scene.triangles()[i]).v.map(|v| v.to_dvec3() - origin);
            let n = (v[1] - v[0]).cross(v[2] - v[0]);
            let (above, down) = (n.dot(v[0]), n.dot(direction));
            let size = v.iter().map(|v| v.length()).fold(0.0, f64::max);
            if above.abs() < CLEAR * n.length() * size || down.abs() < CLEAR * n.length() * direction.length() {
                return None;
            }
            let volumes = [0, 1, 2].map(|k| {
                let (p, q) = (v[k], v[(k + 1) % 3]);
                (p.cross(q).dot(direction) * above.signum(), CLEAR * p.length() * q.length() * direction.length())
            });
            if volumes.iter().any(|(volume, clear)| volume.abs() < *clear) {
                return None;
            }
            let t = above / down;
            Some(Some(t).filter(|t| *t > 0.0 && volumes.iter().all(|(volume, _)| *volume > 0.0)))
        }
    }
}

/// A tile of the picture, and a point in each of its pixels.
fn tile(tracer: &Tracer, random: &mut Random) -> (Tile, PlanePoint) {
    let view = &tracer.settings().view;
    let at = |cells: u32, random: &mut Random| (random.next() * f64::from(cells)) as u32 * EDGE;
    let upper_left = centre(view, at(SIZE.0 / EDGE, random), at(SIZE.1 / EDGE, random));
    (Tile::new(upper_left.x, upper_left.y), upper_left)
}

/// Everything that rays through a tile say of an object against what its cover says.
fn check_cover(tracer: &Tracer, id: u32, cover: &Cover, lens: &Lens, tile: &Tile, random: &mut Random, found: bool) {
    for pixel in 0..64 {
        let (j, k) = (pixel / 8, pixel % 8);
        for _ in 0..3 {
            let (x, y) = (tile.x[k] + random.within(-HALF, HALF), tile.y[j] + random.within(-HALF, HALF));
            match meets(tracer, id, lens.apex, lens.direction(x, y)) {
                Some(Some(t)) => {
                    assert!(found, "{id} is met and not among the candidates");
                    assert!(cover.touched >> pixel & 1 == 1, "{id} is met in pixel {pixel}, which it does not touch");
                    let (lo, hi) = cover.depth.row(tile, j);
                    let near = 1.0 / t;
                    assert!(
                        lo[k] <= near * (1.0 + 1e-6) && near <= hi[k] * (1.0 + 1e-6),
                        "{id}: {near} in {lo:?} {hi:?}"
                    );
                }
                Some(None) => {
                    assert!(cover.covered >> pixel & 1 == 0, "{id} is missed in pixel {pixel}, which it covers")
                }
                None => {}
            }
        }
    }
}

/// The same of every object, by the candidates of the tile.
fn check_all(tracer: &Tracer, lens: &Lens, tile: &Tile, random: &mut Random) {
    let mut found = Vec::new();
    assert!(gather(&tracer.prepared().boxes, &Pyramid::new(lens, tile), 1000, &mut found));
    for id in ids(tracer) {
        let prepared = tracer.prepared();
        let (cover, _) = Figure::of(&prepared.scene, &prepared.local, ObjectId(id)).cover(lens, tile);
        let is_plane = kind(&tracer.prepared().scene, ObjectId(id)).0 == Kind::Plane;
        check_cover(tracer, id, &cover, lens, tile, random, is_plane || found.contains(&id));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn what_a_ray_of_a_tile_meets_is_a_candidate_and_no_nearer_than_told(seed in any::<u64>()) {
        let mut random = Random(seed);
        let tracer = scene(&mut random, false);
        let (tile, _) = tile(&tracer, &mut random);
        let lens = eye(&tracer);
        check_all(&tracer, &lens, &tile, &mut random);
    }

    #[test]
    fn what_is_seen_in_a_flat_mirror_is_a_candidate_too(seed in any::<u64>()) {
        let mut random = Random(seed);
        let tracer = scene(&mut random, false);
        let (tile, _) = tile(&tracer, &mut random);
        let n = random.direction();
        let n = n * (1.0 / n.length());
        let lens = eye(&tracer).mirrored(n, n.dot(random.place()));
        check_all(&tracer, &lens, &tile, &mut random);
    }

    #[test]
    fn a_flat_surface_is_seen_from_a_light_through_a_lens(seed in any::<u64>()) {
        let mut random = Random(seed);
        let tracer = scene(&mut random, false);
        let (tile, _) = tile(&tracer, &mut random);
        let (n, light, eye) = (random.direction(), random.place(), eye(&tracer));
        let n = n * (1.0 / n.length());
        let h = n.dot(random.place());
        let lens = eye.lit_from(light, n, h);
        for _ in 0..50 {
            let (x, y) = (random.within(tile.x[0], tile.x[7]), random.within(tile.y[7], tile.y[0]));
            let direction = eye.direction(x, y);
            let t = h / n.dot(direction);
            if t > 0.0 && t < 1e6 {
                // The point that is seen, from the light.
                let (to, told) = (direction * t - light, lens.direction(x, y));
                let aside = to.cross(told).length() / (to.length() * told.length());
                prop_assert!(aside < 1e-6 && to.dot(told) > 0.0, "{aside}");
                // It is as far as the inverse of |n · direction| of the eye's lens says.
                let far = to.length() / told.length();
                prop_assert!((far * n.dot(direction).abs() - 1.0).abs() < 1e-6, "{far}");
            }
        }
    }

    #[test]
    fn what_stands_between_a_light_and_a_ball_is_in_the_shaft(seed in any::<u64>()) {
        let mut random = Random(seed);
        let tracer = scene(&mut random, false);
        let (light, center, radius) = (random.place(), random.place(), random.within(0.01, 1.0));
        let mut found = Vec::new();
        prop_assert!(gather(&tracer.prepared().boxes, &Shaft::new(light, center, radius), 1000, &mut found));
        for _ in 0..60 {
            let aside = random.direction();
            let to = center + aside * (radius * random.next() / aside.length()) - light;
            for id in ids(&tracer) {
                if kind(&tracer.prepared().scene, ObjectId(id)).0 == Kind::Plane {
                    continue;
                }
                if let Some(Some(t)) = meets(&tracer, id, light, to) && t < 1.0 - 1e-6 {
                    prop_assert!(found.contains(&id), "{id} is between, and not in the shaft");
                }
            }
        }
    }

    #[test]
    fn where_nothing_is_in_doubt_all_points_show_what_the_middle_shows(seed in any::<u64>()) {
        let mut random = Random(seed);
        let tracer = scene(&mut random, true);
        let (_, upper_left) = tile(&tracer, &mut random);
        let (doubt, _) = prove(&tracer, upper_left, 0.5 / 255.0, 48);
        let view = tracer.settings().view;
        let half = [SIZE.0, SIZE.1].map(|n| n as i32 / 2);
        for pixel in (0..64).filter(|k| doubt[*k] == 0.0) {
            let unit = 2 * HALF as i32;
            let x = upper_left.x.div_euclid(unit) + half[0] + (pixel % 8) as i32;
            let y = half[1] - 1 - upper_left.y.div_euclid(unit) + (pixel / 8) as i32;
            let middle = centre(&view, x as u32, y as u32);
            prop_assert_eq!(middle.x - upper_left.x, (pixel % 8) as i32 * unit);
            let sequence = Sequence::new(&view, (x as u32, y as u32), 9);
            let points: Vec<PlanePoint> = std::iter::once(middle).chain((0..32).map(|k| sequence.point(k))).collect();
            let mut samples = vec![Sample::BLANK; points.len()];
            let mut counts = RayCounts::default();
            WaveScratch::with(|scratch| tracer.trace(&points, 0.0, &mut samples, scratch, &mut counts));
            for sample in &samples {
                // Far lights turn by nothing within a pixel; a ball's normals do by a little.
                let apart = (sample.radiance - samples[0].radiance).abs().max_element();
                prop_assert!(apart < 0.05, "pixel {pixel}: {apart}");
            }
        }
    }
}

#[test]
fn most_pixels_of_a_plain_scene_are_proven() {
    let (mut proven, mut all) = (0, 0);
    for seed in 0..100 {
        let mut random = Random(seed);
        let tracer = scene(&mut random, true);
        let (_, upper_left) = tile(&tracer, &mut random);
        let (doubt, _) = prove(&tracer, upper_left, 0.5 / 255.0, 48);
        proven += doubt.iter().filter(|d| **d == 0.0).count();
        all += 64;
    }
    assert!(2 * proven > all, "{proven} of {all}");
}

#[test]
fn an_unknown_depth_is_anything() {
    let tile = Tile::new(0, 0);
    let (lo, hi) = Depth::Unknown.row(&tile, 3);
    assert!(lo.iter().all(|w| *w <= 0.0) && hi.iter().all(|w| *w == f64::INFINITY));
}
