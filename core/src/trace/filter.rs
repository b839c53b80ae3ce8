//! The scene in f32, for the packets that sort out what need not be looked at in f64.
//!
//! Objects are stored in the order leaves name them. Rounding to f32 is covered by the
//! bounds of `trace::packet`, which hold for values within 2⁻²⁴ of local space.

use rayon::prelude::*;

use crate::bvh::Boxes;
use crate::geometry::{Local, V3};
use crate::scene::Scene;
use crate::simd::roomy;

/// A triangle as linear functions of a point: which side of its plane, and two weights.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(crate) struct FlatTriangle {
    /// Unit normal, and n · c0.
    pub(crate) n: [f32; 3],
    pub(crate) h: f32,
    /// Weight of c1 is u · P + u0, of c2 v · P + v0.
    pub(crate) u: [f32; 3],
    pub(crate) u0: f32,
    pub(crate) v: [f32; 3],
    pub(crate) v0: f32,
    /// |u| + |v|: how fast the weights change with the point. Infinite where f32 cannot hold them.
    pub(crate) slope: f32,
    /// Bound on the corners' distances from the origin.
    pub(crate) reach: f32,
    pub(crate) id: u32,
}

/// A sphere.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FlatSphere {
    pub(crate) c: [f32; 3],
    pub(crate) r: f32,
    /// Bound on the distance of its points from the origin.
    pub(crate) reach: f32,
    pub(crate) id: u32,
}

/// A plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FlatPlane {
    pub(crate) n: [f32; 3],
    pub(crate) h: f32,
}

/// What packets meet.
#[derive(Debug)]
pub(crate) struct Filter {
    pub(crate) triangles: Vec<FlatTriangle>,
    pub(crate) spheres: Vec<FlatSphere>,
    pub(crate) planes: Vec<FlatPlane>,
    /// Everything finite is at most this far from the origin.
    pub(crate) reach: f32,
}

fn single(v: V3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn flat_triangle(corners: [V3<f64>; 3], id: u32) -> FlatTriangle {
    let [a, b, c] = corners;
    let (e1, e2) = (b - a, c - a);
    let n = e1.cross(e2);
    let nn = n.dot(n);
    let unit = n * (1.0 / nn.sqrt());
    let u = e2.cross(n) * (1.0 / nn);
    let v = n.cross(e1) * (1.0 / nn);
    let length = |v: V3<f64>| v.dot(v).sqrt();
    let slope = ((length(u) + length(v)) * (1.0 + 1e-6)) as f32;
    let reach = (corners.into_iter().map(length).fold(0.0, f64::max) * (1.0 + 1e-6)) as f32;
    let sound = slope < 1e30 && unit.norm1() > 0.5;
    if !sound {
        // No weight of it is sure or misses: such a triangle is always asked about in f64.
        return FlatTriangle { slope: f32::INFINITY, reach, id, ..FlatTriangle::default() };
    }
    FlatTriangle {
        n: single(unit),
        h: unit.dot(a) as f32,
        u: single(u),
        u0: -u.dot(a) as f32,
        v: single(v),
        v0: -v.dot(a) as f32,
        slope,
        reach,
        id,
    }
}

impl Filter {
    /// The filter of a scene whose boxes are f32; others are not for f32 at all.
    pub(crate) fn new(scene: &Scene, local: &Local, boxes: &Boxes) -> Option<Self> {
        let Boxes::Single(wide) = boxes else { return None };
        let [triangles, spheres] = &wide.ids;
        let first = scene.planes().len() as u32;
        let first_triangle = first + scene.spheres().len() as u32;
        let triangle = |&id: &u32| {
            let t = &scene.triangles()[(id - first_triangle) as usize];
            flat_triangle(local.triangle(t).v, id)
        };
        let sphere = |&id: &u32| {
            let s = &local.spheres[(id - first) as usize];
            let reach = ((s.c.dot(s.c).sqrt() + s.r) * (1.0 + 1e-6)) as f32;
            FlatSphere { c: single(s.c), r: s.r as f32, reach, id }
        };
        let plane = |p: &crate::geometry::plane::LocalPlane| FlatPlane { n: single(p.n), h: p.h as f32 };
        let planes: Vec<_> = local.planes.iter().map(plane).collect();
        // Planes and lights beyond what f32 can square need f64 throughout.
        let near = planes.iter().all(|p| p.h.abs() < 1e12) && local.lights.iter().all(|l| l.abs().max_element() < 1e12);
        near.then(|| {
            let mut filter = Self {
                triangles: roomy(triangles.len()),
                spheres: roomy(spheres.len()),
                planes,
                reach: (wide.radius() * (1.0 + 1e-6)) as f32,
            };
            filter.triangles.par_extend(triangles.par_iter().map(triangle));
            filter.spheres.par_extend(spheres.par_iter().map(sphere));
            filter
        })
    }
}
