//! Rays that know how wrong they may be.

use crate::numeric::{Real, Scalar, TINY, V3};

/// A ray o + t·d in local space, and its distance from the ray of real arithmetic.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray<R = f64> {
    /// Start.
    pub(crate) o: V3<R>,
    /// Direction, of any length.
    pub(crate) d: V3<R>,
    /// Bound on |o − o*|.
    pub(crate) eo: R,
    /// Bound on |d − d*| / |d|.
    pub(crate) ed: R,
    /// d · d.
    pub(crate) dd: R,
    /// 1 / |d|, not less than the real value.
    pub(crate) inv_len: R,
    /// |d|, not less than the real value.
    pub(crate) len: R,
}

impl<R: Real> Ray<R> {
    #[inline(always)]
    pub(crate) fn new(o: V3<R>, d: V3<R>, eo: R, ed: R) -> Self {
        let dd = d.dot(d);
        // A square near the ends of f64's range has lost its digits: nothing is sure then.
        let lost = R::splat(f64::INFINITY);
        let ed = (dd - R::splat(LEAST_SQUARE)).if_positive(ed, lost);
        let ed = (R::splat(GREATEST_SQUARE) - dd).if_positive(ed, lost);
        let len = dd.sqrt() * (R::splat(1.0) + R::splat(8.0 * R::U));
        let inv_len = (R::splat(1.0) + R::splat(16.0 * R::U)) / len;
        Self { o, d, eo: eo + R::splat(TINY), ed, dd, inv_len, len }
    }
}

impl<R: Scalar> Ray<R> {
    /// Whether the real start is surely the origin.
    pub(crate) fn starts_at_origin(&self) -> bool {
        self.eo.to_f64() <= TINY && self.o.norm1().to_f64() == 0.0
    }
}

/// Squares of lengths are trusted between these.
pub(crate) const LEAST_SQUARE: f64 = 1e-270;
const GREATEST_SQUARE: f64 = 1e300;

/// Where along a ray an object is met, if it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span<R = f64> {
    /// The real distance is at least this; 0 where it may be at the start itself.
    pub(crate) lo: R,
    /// The real distance is at most this.
    pub(crate) hi: R,
    /// Whether the object is surely met, at a t > 0.
    pub(crate) sure: bool,
    /// Whether the inner side of a sphere is struck; meaningless for other objects.
    pub(crate) inside: bool,
}

impl Span {
    /// The computed distance; infinite where anything is possible.
    pub(crate) fn middle(&self) -> f64 {
        0.5 * self.lo + 0.5 * self.hi
    }
}

impl<R: Scalar> Span<R> {
    /// t ± e of a sure member of the object: sure if surely in front of the start, `None` if surely not.
    pub(crate) fn around(t: R, e: R, inside: bool) -> Option<Self> {
        let (lo, hi, zero) = (t - e, t + e, R::splat(0.0));
        if hi < zero {
            return None;
        }
        // Written so that a NaN is unsure, over all distances.
        if lo > zero && hi.to_f64().is_finite() {
            Some(Self { lo, hi, sure: true, inside })
        } else {
            Self::unsure(lo, hi, inside)
        }
    }

    /// An object that may or may not be met between `lo` and `hi`.
    pub(crate) fn unsure(lo: R, hi: R, inside: bool) -> Option<Self> {
        let zero = R::splat(0.0);
        if hi < zero {
            return None;
        }
        let lo = if lo > zero { lo } else { zero };
        let hi = if hi >= zero { hi } else { R::splat(f64::INFINITY) };
        Some(Self { lo, hi, sure: false, inside })
    }
}
