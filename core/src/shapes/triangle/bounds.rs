//! Where a triangle is, whether it is anything, and which triangles are one.

use glam::DVec3;

use super::LocalTriangle;
use crate::numeric::{U, zero_area};
use crate::scene::Triangle;
use crate::shapes::bounds::Bounds;
use crate::shapes::{Aabb, Local};

impl Bounds for Triangle {
    /// Empty where it has exactly no area.
    fn bounds(&self, _: usize, local: &Local) -> Aabb {
        if has_no_area(self) { Aabb::EMPTY } else { around(&local.triangle(self)) }
    }

    fn reach(&self, far: impl Fn(DVec3) -> f64) -> f64 {
        let [a, b, c] = self.written;
        if self.by_sides() {
            far(a) + b.abs().max_element().max(c.abs().max_element()) * 0.25
        } else {
            far(a).max(far(b)).max(far(c))
        }
    }

    /// Whether they have the same corners.
    fn coincides(&self, other: &Self) -> bool {
        match (self.exact_corners(), other.exact_corners()) {
            (Some(a), Some(b)) => a.iter().all(|v| b.contains(v)) && b.iter().all(|v| a.contains(v)),
            (None, None) => self.written == other.written,
            _ => false,
        }
    }
}

fn around(t: &LocalTriangle) -> Aabb {
    let b = t.v.iter().fold(Aabb::EMPTY, |b, v| b.around(v.to_dvec3()));
    let v = t.v[0].norm1().max(t.v[1].norm1()).max(t.v[2].norm1());
    b.padded(4.0 * U * v)
}

/// Whether it has exactly no area, so that nothing ever meets it.
pub(crate) fn has_no_area(t: &Triangle) -> bool {
    zero_area::is_zero(&t.written, t.by_sides())
}

/// The longest side in local space, and whether the triangle is more than a million times longer than high.
pub(crate) fn length(t: &LocalTriangle) -> (f64, bool) {
    let v = t.v;
    let edges = [v[1] - v[0], v[2] - v[1], v[0] - v[2]];
    let longest = edges.iter().map(|e| e.dot(*e)).fold(0.0, f64::max).sqrt();
    let area = edges[0].cross(edges[1]);
    // Twice the area over the longest side is the height.
    (longest, area.dot(area).sqrt() < 1e-6 * longest * longest)
}
