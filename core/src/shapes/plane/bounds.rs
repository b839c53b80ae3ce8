//! How far away a plane is said to be.

use glam::DVec3;

use crate::scene::{Plane, PlanePosition};
use crate::shapes::bounds::Bounds;
use crate::shapes::{Aabb, Local};

impl Bounds for Plane {
    fn bounds(&self, _: usize, _: &Local) -> Aabb {
        Aabb::EMPTY
    }

    fn reach(&self, _: impl Fn(DVec3) -> f64) -> f64 {
        0.0
    }
}

/// A quarter of how far the numbers that it is given by are from the eye: `far` says that of a point, and `origin` of
/// the origin.
pub(crate) fn reach(p: &Plane, far: impl Fn(DVec3) -> f64, origin: f64) -> f64 {
    match p.position {
        PlanePosition::Point(q) => far(q),
        PlanePosition::Distance(d) => (d * 0.25).abs() + origin,
    }
}

/// The point that it is said to go through.
pub(crate) fn point(p: &Plane) -> Option<DVec3> {
    match p.position {
        PlanePosition::Point(q) => Some(q),
        PlanePosition::Distance(_) => None,
    }
}
