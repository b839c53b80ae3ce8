//! Where a sphere is, and which spheres are one.

use glam::DVec3;

use super::LocalSphere;
use crate::numeric::U;
use crate::scene::Sphere;
use crate::shapes::Aabb;

/// The box of a sphere, its rounding included.
pub(crate) fn bounds(s: &LocalSphere) -> Aabb {
    Aabb { lo: s.center() - s.r, hi: s.center() + s.r }.padded(4.0 * U * (s.c.norm1() + s.r))
}

/// A quarter of how far it reaches from the eye: `far` says that of a point.
pub(crate) fn reach(s: &Sphere, far: impl Fn(DVec3) -> f64) -> f64 {
    far(s.center) + s.radius * 0.25
}

/// Whether two are the same.
pub(crate) fn coincide(a: &Sphere, b: &Sphere) -> bool {
    a.center == b.center && a.radius == b.radius
}
