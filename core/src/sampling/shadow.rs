//! Where small shadows fall, from the outlines of what casts them.
//!
//! A ray from the light through the middle of an object finds the surface behind; the object's
//! outline, thrown on that surface's tangent plane and from there on the picture, is a shadow
//! that may fall between samples. What is found is only looked at: it need not be exact.

use glam::DVec3;
use rayon::prelude::*;

use super::lattice::vector;
use super::small::{Mark, Polygon, ROUND, What, mark, mark_edges, rim, to_pixels};
use crate::geometry::local::{Kind, kind};
use crate::geometry::{ObjectId, Ray, V3};
use crate::settings::Sampling;
use crate::trace::{PathScratch, Tracer};

/// Triangles of larger meshes have no shadows of their own.
const MESH: usize = 16;
/// Objects times lights that are looked at, at most.
const MOST: usize = 4_000_000;
/// Up to so many, and up to [`MANY`] where every pixel is to keep to the tolerance, it is looked what
/// grazes an object falls on even if something is right behind, and all outlines are followed.
const THOROUGH: usize = 5_000;
const MANY: usize = 50_000;

/// The small shadows of a picture.
pub(crate) fn marks(tracer: &Tracer) -> Vec<Mark> {
    let scene = &tracer.prepared().scene;
    let (first, lights) = (scene.planes().len(), tracer.lights().len());
    let mut faces = vec![0usize; scene.surfaces().len()];
    for t in scene.triangles() {
        faces[t.surface().0 as usize] += 1;
    }
    let alone = |id: &usize| match kind(scene, ObjectId(*id as u32)) {
        Kind::Plane(_) => false,
        Kind::Sphere(_) => true,
        Kind::Triangle(i) => faces[scene.triangles()[i].surface().0 as usize] <= MESH,
    };
    let objects: Vec<usize> = (first..scene.object_count()).filter(alone).collect();
    if objects.len().saturating_mul(lights) > MOST {
        return Vec::new();
    }
    let every_pixel = matches!(tracer.settings().sampling, Sampling::Adaptive { every_pixel: true, .. });
    let thorough = objects.len() * lights <= if every_pixel { MANY } else { THOROUGH };
    objects
        .into_par_iter()
        .map_init(PathScratch::default, |scratch, id| {
            let mut found = Vec::new();
            for light in 0..lights {
                for p in shadows(tracer, id as u32, light, thorough, scratch) {
                    mark(tracer, &p, What::Shadow(light as u32), &mut found);
                    if thorough {
                        mark_edges(tracer, &p, light as u32, &mut found);
                    }
                }
            }
            found
        })
        .flatten_iter()
        .collect()
}

/// The outlines in pixels of an object's shadow, on each plane where it falls first.
fn shadows(tracer: &Tracer, object: u32, light: usize, thorough: bool, scratch: &mut PathScratch) -> Vec<Polygon> {
    let prepared = tracer.prepared();
    let from = tracer.lights()[light];
    let (middle, beyond, rim) = match kind(&prepared.scene, ObjectId(object)) {
        Kind::Plane(_) => return Vec::new(),
        Kind::Sphere(i) => {
            let s = &prepared.local.spheres[i];
            let to = vector(s.c) - from;
            let out = to * (1.0 + s.r / to.dot(to).sqrt() * (1.0 + 1e-6));
            let Some(rim) = rim(to, s.r) else { return Vec::new() };
            (to, out, rim.to_vec())
        }
        Kind::Triangle(i) => {
            let v = prepared.local.triangle(&prepared.scene.triangles()[i]).v.map(|v| vector(v) - from);
            let to = (v[0] + v[1] + v[2]) * (1.0 / 3.0);
            (to, to * (1.0 + 1e-6), v.to_vec())
        }
    };
    let mut behind = |out: DVec3, along: DVec3| {
        tracer.surface_along(&Ray::new(V3::splat(from + out), V3::splat(along), 0.0, 0.0), scratch)
    };
    let mut found: Vec<(DVec3, DVec3)> = behind(beyond, middle).into_iter().collect();
    // Behind what is sunk into a surface is nothing, or something beneath; but what grazes it
    // still falls there.
    if thorough || found.is_empty() {
        for d in [0, ROUND / 4, ROUND / 2, 3 * ROUND / 4].into_iter().filter_map(|k| rim.get(k).map(|&d| d * 1.001)) {
            if let Some((p, n)) = behind(d, d)
                && found
                    .iter()
                    .all(|(q, m)| n.dot(p - *q).abs() > 1e-6 * n.dot(p - from).abs() || n.dot(*m).abs() < 0.999)
            {
                found.push((p, n));
            }
        }
    }
    found.into_iter().filter_map(|(p, n)| thrown(tracer, &rim, from, p, n)).collect()
}

/// What is seen of an outline thrown from a light on the plane through p.
fn thrown(tracer: &Tracer, rim: &[DVec3], from: DVec3, p: DVec3, n: DVec3) -> Option<Polygon> {
    let seen = to_pixels(tracer, p)?;
    let view = &tracer.settings().view;
    let margin = 8.0;
    let near = |x: f64, size: u32| x > -margin && x < f64::from(size) + margin;
    if !(near(seen[0], view.width()) && near(seen[1], view.height())) {
        return None;
    }
    let height = n.dot(p - from);
    let fall = |to: &DVec3| {
        let t = height / n.dot(*to);
        (t > 0.0 && t < 1e6).then(|| to_pixels(tracer, from + *to * t))?
    };
    rim.iter().map(fall).collect()
}
