//! A triangle in local space.

use glam::DVec3;

use super::LocalTriangle;
use crate::numeric::{DoubleDouble, V3};
use crate::scene::Triangle;
use crate::shapes::Local;

impl LocalTriangle {
    /// Corners in local space, each within 2u·(largest corner) of the real ones.
    #[inline]
    pub(crate) fn new(t: &Triangle, local: &Local) -> Self {
        // The same triangle is the same here in whatever form it was written.
        if let Some(corners) = t.exact_corners() {
            return Self { v: corners.map(|v| V3::splat(local.point(v))) };
        }
        let [a, b, c] = t.written;
        let a = local.point(a);
        Self { v: [a, a + local.scaled(b), a + local.scaled(c)].map(V3::splat) }
    }
}

impl LocalTriangle<DoubleDouble> {
    /// Corners to twice the digits.
    pub(crate) fn double(t: &Triangle, local: &Local) -> Self {
        let [a, b, c] = t.written;
        let start = local.double_point(a);
        let other = |v: DVec3| {
            if t.by_sides() { start + V3::splat(local.scaled(v)) } else { local.double_point(v) }
        };
        Self { v: [start, other(b), other(c)] }
    }
}
