//! One source for one lane and for many: kernels are written over [`Real`], so that every
//! width performs the same operations in the same order and gives the same bits.

use std::ops::{Add, Div, Mul, Neg, Sub};

use glam::DVec3;

use super::U;

/// An f64, several side by side, or a [`super::DoubleDouble`]. Operations on f64 are IEEE's, one rounding
/// each, never fused.
pub(crate) trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Bounds an operation's relative error.
    const U: f64;
    fn splat(x: f64) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    /// `self` where it is greater, else `other`; so `other` where either is NaN.
    fn max(self, other: Self) -> Self;
    /// `self` where it is less, else `other`; so `other` where either is NaN.
    fn min(self, other: Self) -> Self;
    /// `a` where `self` > 0, else `b`.
    fn if_positive(self, a: Self, b: Self) -> Self;
}

/// One number, not several side by side: what decisions are taken by.
pub(crate) trait Scalar: Real + PartialOrd {
    /// Rounded.
    fn to_f64(self) -> f64;
}

impl Scalar for f64 {
    fn to_f64(self) -> f64 {
        self
    }
}

impl Real for f64 {
    const U: f64 = U;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn if_positive(self, a: Self, b: Self) -> Self {
        if self > 0.0 { a } else { b }
    }
}

/// Three coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct V3<R> {
    pub(crate) x: R,
    pub(crate) y: R,
    pub(crate) z: R,
}

impl<R: Real> V3<R> {
    #[inline(always)]
    pub(crate) fn splat(v: DVec3) -> Self {
        Self { x: R::splat(v.x), y: R::splat(v.y), z: R::splat(v.z) }
    }
    #[inline(always)]
    pub(crate) fn dot(self, b: Self) -> R {
        self.x * b.x + self.y * b.y + self.z * b.z
    }
    #[inline(always)]
    pub(crate) fn cross(self, b: Self) -> Self {
        Self { x: self.y * b.z - self.z * b.y, y: self.z * b.x - self.x * b.z, z: self.x * b.y - self.y * b.x }
    }
    /// |x| + |y| + |z|: an upper bound of the Euclidean norm, at most √3 times it.
    #[inline(always)]
    pub(crate) fn norm1(self) -> R {
        self.x.abs() + self.y.abs() + self.z.abs()
    }
}

impl<R: Real> V3<R> {
    /// `a` where `condition` > 0, else `b`.
    #[inline(always)]
    pub(crate) fn if_positive(condition: R, a: Self, b: Self) -> Self {
        Self {
            x: condition.if_positive(a.x, b.x),
            y: condition.if_positive(a.y, b.y),
            z: condition.if_positive(a.z, b.z),
        }
    }
}

impl V3<f64> {
    pub(crate) fn to_dvec3(self) -> DVec3 {
        DVec3::new(self.x, self.y, self.z)
    }
}

impl<R: Real> Add for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { x: self.x + b.x, y: self.y + b.y, z: self.z + b.z }
    }
}

impl<R: Real> Sub for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { x: self.x - b.x, y: self.y - b.y, z: self.z - b.z }
    }
}

impl<R: Real> Mul<R> for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, k: R) -> Self {
        Self { x: self.x * k, y: self.y * k, z: self.z * k }
    }
}

impl<R: Real> Neg for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}
