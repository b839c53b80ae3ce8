//! Where a sphere is, and which spheres are one.

use glam::DVec3;

use crate::numeric::U;
use crate::scene::Sphere;
use crate::shapes::bounds::Bounds;
use crate::shapes::{Aabb, Local};

impl Bounds for Sphere {
    fn bounds(&self, i: usize, local: &Local) -> Aabb {
        let s = &local.spheres[i];
        Aabb { lo: s.center() - s.r, hi: s.center() + s.r }.padded(4.0 * U * (s.c.norm1() + s.r))
    }

    fn reach(&self, far: impl Fn(DVec3) -> f64) -> f64 {
        far(self.center) + self.radius * 0.25
    }

    fn coincides(&self, other: &Self) -> bool {
        self.center == other.center && self.radius == other.radius
    }
}
