//! Where small shadows fall, from the outlines of what casts them.
//!
//! A ray from the light through the middle of an object finds the surface behind; the object's
//! outline, thrown on that surface's tangent plane and from there on the picture, is a shadow
//! that may fall between samples. What is found is only looked at: it need not be exact.

use glam::DVec3;
use rayon::prelude::*;

use super::outline::vector;
use super::small::{Mark, Polygon, What, mark, rim, to_pixels};
use crate::geometry::local::{Kind, kind};
use crate::geometry::{ObjectId, Ray, V3};
use crate::trace::{PathScratch, Tracer};

/// Triangles of larger meshes have no shadows of their own.
const MESH: usize = 16;
/// Objects times lights that are looked at, at most.
const MOST: usize = 4_000_000;

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
    objects
        .into_par_iter()
        .map_init(PathScratch::default, |scratch, id| {
            let mut found = Vec::new();
            for light in 0..lights {
                if let Some(p) = shadow(tracer, id as u32, light, scratch) {
                    mark(tracer, &p, What::Shadow(light as u32), &mut found);
                }
            }
            found
        })
        .flatten_iter()
        .collect()
}

/// The outline in pixels of an object's shadow where it falls first.
fn shadow(tracer: &Tracer, object: u32, light: usize, scratch: &mut PathScratch) -> Option<Polygon> {
    let prepared = tracer.prepared();
    let from = tracer.lights()[light];
    let (middle, beyond, rim) = match kind(&prepared.scene, ObjectId(object)) {
        Kind::Plane(_) => return None,
        Kind::Sphere(i) => {
            let s = &prepared.local.spheres[i];
            let to = vector(s.c) - from;
            let out = to * (1.0 + s.r / to.dot(to).sqrt() * (1.0 + 1e-6));
            (to, out, rim(to, s.r)?.to_vec())
        }
        Kind::Triangle(i) => {
            let v = prepared.local.triangle(&prepared.scene.triangles()[i]).v.map(|v| vector(v) - from);
            let to = (v[0] + v[1] + v[2]) * (1.0 / 3.0);
            (to, to * (1.0 + 1e-6), v.to_vec())
        }
    };
    let ray = Ray::new(V3::splat(from + beyond), V3::splat(middle), 0.0, 0.0);
    let (p, n) = tracer.surface_along(&ray, scratch)?;
    let seen = to_pixels(tracer, p)?;
    let view = &tracer.settings().view;
    let margin = 8.0;
    let near = |x: f64, size: u32| x > -margin && x < f64::from(size) + margin;
    if !(near(seen[0], view.width()) && near(seen[1], view.height())) {
        return None;
    }
    let height = n.dot(p - from);
    let fall = |to: DVec3| {
        let t = height / n.dot(to);
        (t > 0.0 && t < 1e6).then(|| to_pixels(tracer, from + to * t))?
    };
    rim.into_iter().map(fall).collect()
}
