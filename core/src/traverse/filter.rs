//! The scene in f32, for the packets that sort out what need not be looked at in f64.
//!
//! Rounding to f32 is covered by the bounds of `traverse::packet`, which hold for values within 2⁻²⁴ of
//! local space.

use super::giants::Giants;
use super::packet::{Leaves, U32};
use crate::bvh::{Boxes, Coordinate};
use crate::numeric::{U, V3};
use crate::scene::Scene;
use crate::shapes::Local;
use crate::shapes::sphere::giant::GiantSphere;
use crate::shapes::triangle::giant::GiantTriangle;

/// Numbers of a triangle, as linear functions of a point P: the unit normal n and n · c0; u and u0,
/// v and v0, where u · P + u0 is the weight of c1 and v · P + v0 that of c2; |u| + |v|, how fast the
/// weights change with the point, infinite where f32 cannot hold them; a bound on the corners'
/// distances from the origin; a number for the id, not a tiny one, for it is read with others.
pub(crate) const TRIANGLE: usize = 15;
/// Numbers of a sphere: centre, radius, a bound on the distance of its points from the origin, the
/// id's bits.
pub(crate) const SPHERE: usize = 6;

/// Squares of lesser radii, and what they are rounded by, are not for f32.
const LEAST_RADIUS: f64 = 1e-15;

/// A quarter of what f32 rounds by.
const SINGLE: f64 = U32 as f64 / 4.0;

/// A plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FlatPlane {
    pub(crate) n: [f32; 3],
    pub(crate) h: f32,
    /// Whether it passes exactly through the eye, from where it is not seen then.
    pub(crate) through_eye: bool,
}

/// A sphere around the eye, see [`crate::shapes::sphere::giant`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct FlatSphere {
    pub(crate) id: u32,
    pub(crate) m: [f32; 3],
    pub(crate) q: f32,
    pub(crate) k: f32,
}

impl FlatSphere {
    fn new((id, s): &(u32, GiantSphere)) -> Self {
        Self { id: *id, m: single(s.m), q: s.q as f32, k: s.k as f32 }
    }
}

/// A triangle around the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FlatTriangle {
    pub(crate) id: u32,
    pub(crate) plane: FlatPlane,
    pub(crate) u: [f32; 3],
    pub(crate) u0: f32,
    pub(crate) v: [f32; 3],
    pub(crate) v0: f32,
    /// |u| + |v|.
    pub(crate) slope: f32,
    /// |u0| + |v0| + 1, rounded up.
    pub(crate) terms: f32,
}

impl FlatTriangle {
    fn new((id, t): &(u32, GiantTriangle)) -> Self {
        let plane = FlatPlane { n: single(t.plane.n), h: t.plane.h as f32, through_eye: false };
        let slope = ((t.u.norm1() + t.v.norm1()) * (1.0 + 1e-6)) as f32;
        let terms = ((t.u0.abs() + t.v0.abs() + 1.0) * (1.0 + 1e-6)) as f32;
        Self { id: *id, plane, u: single(t.u), u0: t.u0 as f32, v: single(t.v), v0: t.v0 as f32, slope, terms }
    }
}

/// What packets meet.
#[derive(Debug)]
pub(crate) struct Filter {
    pub(crate) triangles: Leaves<TRIANGLE>,
    pub(crate) spheres: Leaves<SPHERE>,
    pub(crate) planes: Vec<FlatPlane>,
    /// Objects far larger than what is seen of them; what stands for them in leaves is never met.
    pub(crate) giant_spheres: Vec<FlatSphere>,
    pub(crate) giant_triangles: Vec<FlatTriangle>,
    /// Everything finite is at most this far from the origin.
    pub(crate) reach: f32,
}

/// What no ray meets, but for one square to the normal, which leaves it in doubt; the last stands for the id.
const NEVER_TRIANGLE: [f32; TRIANGLE] =
    [0.61, 0.37, 0.7, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, f32::NAN];

/// A point that no ray of a scene comes near.
const NEVER_SPHERE: [f32; SPHERE] = [1e15, -0.7e15, 0.3e15, 0.0, 0.0, f32::NAN];

fn single(v: V3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// What corners may be misplaced by, and products of sides rounded by, as shares of the greatest of each.
const ROUNDED: f64 = 32.0 * U;

fn triangle(corners: [V3<f64>; 3], id: u32) -> [f32; TRIANGLE] {
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
    let id = f32::from_tag(id);
    // The normal of a needle has lost what its sides have in common.
    let side = e1.norm1() + e2.norm1();
    let lost = ROUNDED * side * (side + a.norm1());
    let sound = slope < 1e25 && unit.norm1() > 0.5 && lost < SINGLE * nn.sqrt();
    if !sound {
        // No weight of it is sure or misses: such a triangle is always asked about in f64.
        return [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, f32::INFINITY, reach, id];
    }
    let [n, u, v] = [(unit, unit.dot(a)), (u, -u.dot(a)), (v, -v.dot(a))].map(|(v, x)| (single(v), x as f32));
    let row = |([x, y, z], w): ([f32; 3], f32)| [x, y, z, w];
    let [[n0, n1, n2, h], [u1, u2, u3, u0], [v1, v2, v3, v0]] = [n, u, v].map(row);
    [n0, n1, n2, h, u1, u2, u3, u0, v1, v2, v3, v0, slope, reach, id]
}

impl Filter {
    /// The filter of a scene whose boxes are f32; others are not for f32 at all.
    pub(crate) fn new(scene: &Scene, local: &Local, boxes: &Boxes, giants: &Giants) -> Option<Self> {
        let Boxes::F32(bvh) = boxes else { return None };
        let first = scene.planes().len() as u32;
        let first_triangle = first + scene.spheres().len() as u32;
        // Which giants f32 holds: of others nothing is sure in leaves.
        let normal = |x: f32| x.abs() > 1e-30 && x.abs() < 1e30;
        let spheres: Vec<_> =
            giants.spheres.iter().map(FlatSphere::new).filter(|s| normal(s.q) && normal(s.k)).collect();
        let fits = |t: &FlatTriangle| normal(t.plane.h) && t.slope < 1e25 && t.terms < 1e25;
        let triangles: Vec<_> = giants.triangles.iter().map(FlatTriangle::new).filter(fits).collect();
        let triangle = |id| {
            if triangles.iter().any(|t| t.id == id) {
                return NEVER_TRIANGLE.map(|x| if x.is_nan() { f32::from_tag(id) } else { x });
            }
            triangle(local.triangle(&scene.triangles()[(id - first_triangle) as usize]).v, id)
        };
        let sphere = |id| {
            if spheres.iter().any(|s| s.id == id) {
                return NEVER_SPHERE.map(|x| if x.is_nan() { f32::from_tag(id) } else { x });
            }
            let s = &local.spheres[(id - first) as usize];
            let sound = s.r > LEAST_RADIUS;
            // Of a sphere that is met within any distance, nothing is sure in f32.
            let reach = if sound { ((s.c.dot(s.c).sqrt() + s.r) * (1.0 + 1e-6)) as f32 } else { f32::INFINITY };
            let [x, y, z] = single(s.c);
            [x, y, z, s.r as f32, reach, f32::from_tag(id)]
        };
        let plane =
            |p: &crate::shapes::plane::LocalPlane| FlatPlane { n: single(p.n), h: p.h as f32, through_eye: p.h == 0.0 };
        let planes: Vec<_> = local.planes.iter().map(plane).collect();
        // Planes and lights beyond what f32 can square need f64 throughout.
        let near = planes.iter().all(|p| p.h.abs() < 1e12) && local.lights.iter().all(|l| l.abs().max_element() < 1e12);
        near.then(|| Self {
            triangles: Leaves::new(bvh, 0, triangle),
            spheres: Leaves::new(bvh, 1, sphere),
            planes,
            giant_spheres: spheres.clone(),
            giant_triangles: triangles.clone(),
            reach: (bvh.radius() * (1.0 + 1e-6)) as f32,
        })
    }
}
