//! Where a sphere is, and which spheres are one.

use super::LocalSphere;
use crate::numeric::U;
use crate::scene::Sphere;
use crate::shapes::Aabb;

/// The box of a sphere, its rounding included.
pub(crate) fn bounds(s: &LocalSphere) -> Aabb {
    Aabb { lo: s.center() - s.r, hi: s.center() + s.r }.padded(4.0 * U * (s.c.norm1() + s.r))
}

/// Whether two are the same.
pub(crate) fn coincide(a: &Sphere, b: &Sphere) -> bool {
    a.center == b.center && a.radius == b.radius
}
