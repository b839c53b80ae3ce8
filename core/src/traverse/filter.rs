//! The scene in f32, for the packets that sort out what need not be looked at in f64.
//!
//! Rounding to f32 is covered by the bounds of `traverse::packet`, which hold for values within 2⁻²⁴ of
//! local space.

use rayon::prelude::*;

use crate::bvh::Boxes;
use crate::scene::Scene;
use crate::shapes::{Columns, Local, ObjectId, bounds, column, plane};

/// Boxes are wider by this share of their distance from the origin, for what f32 misplaces rays by there: so that
/// nothing far away widens those that are near. See `traverse::packet`.
pub(super) const SLACK: f64 = 12.0 / (1 << 24) as f64;

/// What packets meet.
#[derive(Debug)]
pub(crate) struct Filter {
    pub(crate) columns: Columns,
    /// Whether some objects are giants there, and not met in leaves.
    pub(crate) has_giants: bool,
    pub(crate) planes: Vec<plane::filter::Plane>,
    /// Everything in leaves that is met there is at most this far from the origin.
    pub(crate) reach: f32,
}

impl Filter {
    /// The filter of a scene whose boxes are f32; others are not for f32 at all.
    pub(crate) fn new(scene: &Scene, local: &Local, boxes: &Boxes) -> Option<Self> {
        let Boxes::F32(bvh) = boxes else { return None };
        let planes: Vec<_> = local.planes.iter().map(plane::filter::Plane::new).collect();
        // Planes and lights beyond what f32 can square need f64 throughout.
        let near = planes.iter().all(|p| p.h.abs() < 1e12) && local.lights.iter().all(|l| l.abs().max_element() < 1e12);
        if !near {
            return None;
        }
        let columns = Columns::new(scene, local, bvh);
        let mut giants = Vec::new();
        column!(columns, O, column => giants.extend(column.giants.iter().map(|(id, _)| *id)));
        let mut reach = bvh.radius();
        if !giants.is_empty() {
            let far = |id: &u32| bounds(scene, local, ObjectId(*id)).farthest();
            let others = bvh.ids.par_iter().flatten().filter(|id| !giants.contains(id));
            reach = reach.min(others.map(far).reduce(|| 0.0, f64::max));
        }
        Some(Self { columns, has_giants: !giants.is_empty(), planes, reach: (reach * (1.0 + 1e-6)) as f32 })
    }
}
