//! Axis-aligned boxes.

use glam::DVec3;

/// A closed box; empty where a lower bound exceeds its upper one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Aabb {
    pub(crate) lo: DVec3,
    pub(crate) hi: DVec3,
}

impl Aabb {
    pub(crate) const EMPTY: Self = Self { lo: DVec3::INFINITY, hi: DVec3::NEG_INFINITY };

    pub(crate) fn around(self, p: DVec3) -> Self {
        Self { lo: self.lo.min(p), hi: self.hi.max(p) }
    }

    /// How far its farthest corner is from the origin.
    pub(crate) fn farthest(&self) -> f64 {
        self.lo.abs().max(self.hi.abs()).length()
    }

    /// Wider by `by` on every side.
    pub(crate) fn padded(self, by: f64) -> Self {
        Self { lo: self.lo - by, hi: self.hi + by }
    }
}
