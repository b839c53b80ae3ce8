//! Rays that know how wrong they may be.

use glam::DVec3;

use super::{TINY, U};

/// A ray o + t·d in local space, and its distance from the ray of real arithmetic.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    /// Start.
    pub(crate) o: DVec3,
    /// Direction, of any length.
    pub(crate) d: DVec3,
    /// Bound on |o − o*|.
    pub(crate) eo: f64,
    /// Bound on |d − d*| / |d|.
    pub(crate) ed: f64,
    /// d · d.
    pub(crate) dd: f64,
    /// 1 / |d|, not less than the real value.
    pub(crate) inv_len: f64,
    /// |d|, not less than the real value.
    pub(crate) len: f64,
}

impl Ray {
    pub(crate) fn new(o: DVec3, d: DVec3, eo: f64, ed: f64) -> Self {
        let dd = d.dot(d);
        let len = dd.sqrt() * (1.0 + 8.0 * U);
        let inv_len = (1.0 + 16.0 * U) / len;
        Self { o, d, eo: eo + TINY, ed, dd, inv_len, len }
    }
}

/// Where along a ray an object is met, if it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    /// The real distance is at least this; 0 where it may be at the start itself.
    pub(crate) lo: f64,
    /// The real distance is at most this.
    pub(crate) hi: f64,
    /// The computed distance, between `lo` and `hi`.
    pub(crate) t: f64,
    /// Whether the object is surely met, at a t > 0.
    pub(crate) sure: bool,
    /// Whether the inner side of a sphere is struck; meaningless for other objects.
    pub(crate) inside: bool,
}

impl Span {
    /// t ± e of a sure member of the object: sure if surely in front of the start, `None` if surely not.
    pub(crate) fn around(t: f64, e: f64, inside: bool) -> Option<Self> {
        let (lo, hi) = (t - e, t + e);
        if hi < 0.0 {
            return None;
        }
        // Written so that a NaN is unsure, over all distances.
        if lo > 0.0 && hi.is_finite() {
            Some(Self { lo, hi, t, sure: true, inside })
        } else if hi >= 0.0 {
            Some(Self { lo: lo.max(0.0), hi, t, sure: false, inside })
        } else {
            Some(Self { lo: 0.0, hi: f64::INFINITY, t, sure: false, inside })
        }
    }

    /// An object that may or may not be met between `lo` and `hi`.
    pub(crate) fn unsure(lo: f64, hi: f64, t: f64, inside: bool) -> Option<Self> {
        if hi < 0.0 {
            return None;
        }
        let lo = if lo > 0.0 { lo } else { 0.0 };
        let hi = if hi >= 0.0 { hi } else { f64::INFINITY };
        Some(Self { lo, hi, t, sure: false, inside })
    }
}
