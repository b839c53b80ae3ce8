//! Vectors of [`Big`] components.

use std::ops::{Add, Mul, Neg, Sub};

use glam::DVec3;

use super::Big;

/// Three components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vector<const N: usize>(pub [Big<N>; 3]);

impl<const N: usize> Vector<N> {
    /// The zero vector.
    pub const ZERO: Self = Self([Big::ZERO; 3]);

    /// `v` exactly; `v` must be finite.
    #[must_use]
    pub fn new(v: DVec3) -> Self {
        Self([Big::new(v.x), Big::new(v.y), Big::new(v.z)])
    }

    /// The same vector in M limbs, truncated or padded with zeros.
    #[must_use]
    pub fn resize<const M: usize>(&self) -> Vector<M> {
        Vector(self.0.map(|c| c.resize()))
    }

    /// a · b.
    #[must_use]
    pub fn dot(&self, b: &Self) -> Big<N> {
        self.0[0] * b.0[0] + self.0[1] * b.0[1] + self.0[2] * b.0[2]
    }

    /// a × b.
    #[must_use]
    pub fn cross(&self, b: &Self) -> Self {
        let ([ax, ay, az], [bx, by, bz]) = (self.0, b.0);
        Self([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    }

    /// The Euclidean length.
    #[must_use]
    pub fn length(&self) -> Big<N> {
        self.dot(self).sqrt()
    }

    /// The unit vector of this direction; zero for zero.
    #[must_use]
    pub fn normalize(&self) -> Self {
        *self * self.length().reciprocal()
    }

    /// Whether every component is zero.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        self.0.iter().all(Big::is_zero)
    }

    /// Every component times 2^k, exactly.
    #[must_use]
    pub fn scale(&self, k: i64) -> Self {
        Self(self.0.map(|c| c.scale(k)))
    }

    /// e such that the largest component lies in [2^(e−1), 2^e); `i64::MIN` for zero.
    #[must_use]
    pub fn exponent(&self) -> i64 {
        self.0.iter().map(Big::exponent).max().unwrap_or(i64::MIN)
    }

    /// Each component rounded to the nearest f64.
    #[must_use]
    pub fn to_f64(&self) -> DVec3 {
        DVec3::from_array(self.0.map(|c| c.to_f64()))
    }
}

impl<const N: usize> Add for Vector<N> {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self([self.0[0] + b.0[0], self.0[1] + b.0[1], self.0[2] + b.0[2]])
    }
}

impl<const N: usize> Sub for Vector<N> {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Self([self.0[0] - b.0[0], self.0[1] - b.0[1], self.0[2] - b.0[2]])
    }
}

impl<const N: usize> Neg for Vector<N> {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|c| -c))
    }
}

impl<const N: usize> Mul<Big<N>> for Vector<N> {
    type Output = Self;
    fn mul(self, k: Big<N>) -> Self {
        Self(self.0.map(|c| c * k))
    }
}
