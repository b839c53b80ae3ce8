//! Where objects are, and which are one.

use glam::DVec3;

use super::{Aabb, Listed, Local, ObjectId, kind, of_shape};
use crate::scene::Scene;

/// Where an object is.
pub(crate) trait Bounds: Listed {
    /// Its box, rounding included, it being the `i`-th of its shape; empty where nothing ever meets it, and of what
    /// leaves do not hold.
    fn bounds(&self, i: usize, local: &Local) -> Aabb;

    /// A quarter of how far it reaches from the eye: `far` says that of a point; 0 of what is infinitely large.
    fn reach(&self, far: impl Fn(DVec3) -> f64) -> f64;

    /// Whether two are the same but for their surfaces: the first of them in the document is what is met where either
    /// is, at the very same distance, so that the other never matters.
    fn coincides(&self, _other: &Self) -> bool {
        false
    }
}

/// The box of object `id`.
pub(crate) fn bounds(scene: &Scene, local: &Local, id: ObjectId) -> Aabb {
    of_shape!(scene, id, O, i => O::all(scene)[i].bounds(i, local))
}

/// Whether two objects [coincide](Bounds::coincides).
pub(crate) fn coincide(scene: &Scene, a: ObjectId, b: ObjectId) -> bool {
    let (kind, j) = kind(scene, b);
    of_shape!(scene, a, O, i => O::KIND == kind && O::all(scene)[i].coincides(&O::all(scene)[j]))
}
