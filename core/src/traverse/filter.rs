//! The scene in f32, for the packets that sort out what need not be looked at in f64.
//!
//! Rounding to f32 is covered by the bounds of `traverse::packet`, which hold for values within 2⁻²⁴ of
//! local space.

use rayon::prelude::*;

use super::packet::Leaves;
use crate::bvh::{Boxes, Coordinate};
use crate::scene::Scene;
use crate::shapes::giants::Giants;
use crate::shapes::{
    Local, ObjectId, SPHERES, TRIANGLES, bounds, first_sphere, first_triangle, plane, sphere, triangle,
};

/// Boxes are wider by this share of their distance from the origin, for what f32 misplaces rays by there: so that
/// nothing far away widens those that are near. See `traverse::packet`.
pub(super) const SLACK: f64 = 12.0 / (1 << 24) as f64;

/// What packets meet.
#[derive(Debug)]
pub(crate) struct Filter {
    pub(crate) triangles: Leaves<{ triangle::filter::NUMBERS }>,
    pub(crate) spheres: Leaves<{ sphere::filter::NUMBERS }>,
    pub(crate) planes: Vec<plane::filter::Plane>,
    /// Objects far larger than what is seen of them; what stands for them in leaves is never met.
    pub(crate) giant_spheres: Vec<sphere::filter::Giant>,
    pub(crate) giant_triangles: Vec<triangle::filter::Giant>,
    /// Everything in leaves that is met there is at most this far from the origin.
    pub(crate) reach: f32,
}

impl Filter {
    /// The filter of a scene whose boxes are f32; others are not for f32 at all.
    pub(crate) fn new(scene: &Scene, local: &Local, boxes: &Boxes, giants: &Giants) -> Option<Self> {
        let Boxes::F32(bvh) = boxes else { return None };
        let (first, first_triangle) = (first_sphere(scene), first_triangle(scene));
        // Which giants f32 holds: of others nothing is sure in leaves.
        let spheres: Vec<_> =
            giants.spheres.iter().filter_map(|(id, (s, _))| sphere::filter::Giant::new(*id, s)).collect();
        let triangles: Vec<_> =
            giants.triangles.iter().filter_map(|(id, t)| triangle::filter::Giant::new(*id, t)).collect();
        let triangle = |id| {
            if triangles.iter().any(|t| t.id == id) {
                return triangle::filter::never(f32::from_tag(id));
            }
            let corners = local.triangle(&scene.triangles()[(id - first_triangle) as usize]).v;
            triangle::filter::row(corners, f32::from_tag(id))
        };
        let sphere = |id| {
            if spheres.iter().any(|s| s.id == id) {
                return sphere::filter::never(f32::from_tag(id));
            }
            sphere::filter::row(&local.spheres[(id - first) as usize], f32::from_tag(id))
        };
        let planes: Vec<_> = local.planes.iter().map(plane::filter::Plane::new).collect();
        // Planes and lights beyond what f32 can square need f64 throughout.
        let near = planes.iter().all(|p| p.h.abs() < 1e12) && local.lights.iter().all(|l| l.abs().max_element() < 1e12);
        let giant = |id: u32| spheres.iter().any(|s| s.id == id) || triangles.iter().any(|t| t.id == id);
        let all = bvh.radius();
        let reach = if spheres.is_empty() && triangles.is_empty() {
            all
        } else {
            let far = |id: &u32| bounds(scene, local, ObjectId(*id)).farthest();
            let others = bvh.ids.par_iter().flatten().filter(|id| !giant(**id)).map(far).reduce(|| 0.0, f64::max);
            all.min(others)
        };
        near.then(|| Self {
            triangles: Leaves::new(bvh, TRIANGLES, triangle),
            spheres: Leaves::new(bvh, SPHERES, sphere),
            planes,
            giant_spheres: spheres.clone(),
            giant_triangles: triangles.clone(),
            reach: (reach * (1.0 + 1e-6)) as f32,
        })
    }
}
