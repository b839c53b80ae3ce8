//! Numbers that know how wrong they may be, and how near to zero they can be without being zero.
//!
//! A [`Ball`] is a [`Big`] and a bound of its error. Sums, products and roots that fit into the
//! number's width are exact and say so, so that what is exact stays exact.
//!
//! **Proof of zero.** A number made of integers by sums, products and square roots is an algebraic
//! integer. Its conjugates are what the same expression gives under other signs of its roots, at
//! most 2^k for k different roots, and their product is an integer. So a number that is not zero is at
//! least u^(1−2^k) in magnitude, where u bounds all of its conjugates; an interval around zero that is
//! narrower holds zero alone (Burnikel, Fleischer, Mehlhorn, Schirra, *A strong and easily
//! computable separation bound for arithmetic expressions involving radicals*, Algorithmica
//! 27, 2000).

use super::{Big, Bound, Vector};

/// These numbers are not wide enough to tell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unsure;

/// A real number to 64·N bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball<const N: usize> {
    mid: Big<N>,
    error: Bound,
    /// All conjugates are at most 2^size in magnitude.
    size: i64,
    /// The square roots it is made of, a bit each.
    roots: u32,
}

/// Names the square roots of one computation.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Roots(u32);

impl Roots {
    fn next(&mut self) -> u32 {
        // Beyond 32 roots nothing is proven to be zero in any width, so that they may share a name.
        let bit = 1u32.checked_shl(self.0).unwrap_or(1 << 31);
        self.0 += 1;
        bit
    }
}

/// Bits from the highest that is set to the lowest.
fn digits<const N: usize>(x: &Big<N>) -> i64 {
    64 * N as i64 - x.trailing_zeros()
}

impl<const N: usize> Ball<N> {
    pub(crate) const ZERO: Self = Self { mid: Big::ZERO, error: Bound::ZERO, size: 0, roots: 0 };

    /// An integer, exactly.
    pub(crate) fn integer(x: f64) -> Self {
        Self::scaled(x, 0)
    }

    /// x · 2^k, which must be an integer, exactly.
    pub(crate) fn scaled(x: f64, k: i64) -> Self {
        let mid = Big::new(x).scale(k);
        Self { mid, error: Bound::ZERO, size: mid.exponent().max(0), roots: 0 }
    }

    /// The sign; 0 only where the number is proven to be zero.
    pub(crate) fn sign(&self) -> Result<i32, Unsure> {
        let (error, most) = (self.error.exponent(), self.mid.exponent());
        // |mid| ≥ 2^(most − 1), and the error is below 2^error.
        if self.error == Bound::ZERO || most > error {
            return Ok(self.mid.signum());
        }
        let conjugates = (1i64 << self.roots.count_ones()) - 1;
        let least = self.size.saturating_mul(conjugates).saturating_neg();
        if error.max(most).saturating_add(1) <= least { Ok(0) } else { Err(Unsure) }
    }

    /// The square root of what is known not to be below zero.
    pub(crate) fn sqrt(&self, roots: &mut Roots) -> Self {
        let (mid, size) = (self.mid.sqrt(), self.size / 2 + 1);
        if self.error == Bound::ZERO && 2 * digits(&mid) <= 64 * N as i64 && mid * mid == self.mid {
            return Self { mid, error: Bound::ZERO, size, roots: self.roots };
        }
        // |√a − √b| ≤ |a − b| / √a, and at most √|a − b|.
        let within = self.error.over(&mid);
        let half = Bound::power((self.error.exponent() + 1).div_euclid(2) + 1);
        let moved = if self.error == Bound::ZERO || within.exponent() < half.exponent() { within } else { half };
        let error = moved + Bound::of(&mid) * Bound::rounding::<N>();
        Self { mid, error, size, roots: self.roots | roots.next() }
    }

    /// Twice the number.
    pub(crate) fn doubled(self) -> Self {
        Self { mid: self.mid.scale(1), error: self.error.scale(1), size: self.size + 1, ..self }
    }

    /// Whether the error is below 2^−bits of the number.
    pub(crate) fn is_known_to(&self, bits: i64) -> bool {
        self.error == Bound::ZERO || self.error.exponent() <= self.mid.exponent().saturating_sub(bits)
    }

    pub(crate) fn mid(&self) -> &Big<N> {
        &self.mid
    }

    pub(crate) fn error(&self) -> Bound {
        self.error
    }

    fn sum(&self, o: &Self, subtract: bool) -> Self {
        let mid = if subtract { self.mid - o.mid } else { self.mid + o.mid };
        let (roots, mut error) = (self.roots | o.roots, self.error + o.error);
        let size = self.size.max(o.size).saturating_add(1);
        if !self.mid.is_zero() && !o.mid.is_zero() {
            let lowest = |x: &Big<N>| x.exponent() - digits(x);
            let highest = self.mid.exponent().max(o.mid.exponent());
            if highest - lowest(&self.mid).min(lowest(&o.mid)) >= 64 * N as i64 {
                error = error + (Bound::of(&self.mid) + Bound::of(&o.mid)) * Bound::rounding::<N>();
            }
        }
        Self { mid, error, size, roots }
    }
}

impl<const N: usize> std::ops::Add for Ball<N> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        self.sum(&o, false)
    }
}

impl<const N: usize> std::ops::Sub for Ball<N> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self.sum(&o, true)
    }
}

impl<const N: usize> std::ops::Neg for Ball<N> {
    type Output = Self;
    fn neg(self) -> Self {
        Self { mid: -self.mid, ..self }
    }
}

impl<const N: usize> std::ops::Mul for Ball<N> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let mid = self.mid * o.mid;
        let (a, b) = (Bound::of(&self.mid), Bound::of(&o.mid));
        let mut error = a * o.error + b * self.error + self.error * o.error;
        if !mid.is_zero() && digits(&self.mid) + digits(&o.mid) > 64 * N as i64 {
            error = error + Bound::of(&mid) * Bound::rounding::<N>();
        }
        Self { mid, error, size: self.size.saturating_add(o.size), roots: self.roots | o.roots }
    }
}

/// Three of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Balls<const N: usize>(pub(crate) [Ball<N>; 3]);

impl<const N: usize> Balls<N> {
    /// v · 2^k, which must be integers, exactly.
    pub(crate) fn scaled(v: glam::DVec3, k: i64) -> Self {
        Self(v.to_array().map(|x| Ball::scaled(x, k)))
    }

    pub(crate) fn dot(&self, o: &Self) -> Ball<N> {
        self.0[0] * o.0[0] + self.0[1] * o.0[1] + self.0[2] * o.0[2]
    }

    pub(crate) fn cross(&self, o: &Self) -> Self {
        let ([ax, ay, az], [bx, by, bz]) = (self.0, o.0);
        Self([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    }

    pub(crate) fn mid(&self) -> Vector<N> {
        Vector(self.0.map(|c| c.mid))
    }

    /// A bound of each component's error.
    pub(crate) fn error(&self) -> Bound {
        self.0.iter().fold(Bound::ZERO, |sum, c| sum + c.error)
    }

    /// Whether the error is below 2^−bits of the largest component.
    pub(crate) fn is_known_to(&self, bits: i64) -> bool {
        let error = self.error();
        error == Bound::ZERO || error.exponent() <= self.mid().exponent().saturating_sub(bits)
    }
}

impl<const N: usize> std::ops::Add for Balls<N> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + o.0[k]))
    }
}

impl<const N: usize> std::ops::Sub for Balls<N> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] - o.0[k]))
    }
}

impl<const N: usize> std::ops::Mul<Ball<N>> for Balls<N> {
    type Output = Self;
    fn mul(self, k: Ball<N>) -> Self {
        Self(self.0.map(|c| c * k))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn n<const N: usize>(x: f64) -> Ball<N> {
        Ball::integer(x)
    }

    #[test]
    fn what_fits_is_exact_and_what_does_not_says_so() {
        let (a, b) = (Ball::<4>::scaled(1e60, 0), n::<4>(3.0));
        assert_eq!((a + b).error, Bound::ZERO);
        assert_eq!((a * b - a * b).sign().ok(), Some(0));
        let far = Ball::<4>::scaled(1.0, 300) + n(1.0);
        assert_ne!(far.error, Bound::ZERO);
        // 1 is lost beside 2^300, but not its being there.
        assert!((far - Ball::scaled(1.0, 300)).sign().is_err());
        let far = Ball::<8>::scaled(1.0, 300) + n(1.0);
        assert_eq!((far - Ball::scaled(1.0, 300)).sign().ok(), Some(1));
    }

    #[test]
    fn equal_by_different_ways_is_proven_to_be_zero() {
        let mut roots = Roots::default();
        // √2 √3 = √6, (√2 + √3)² = 5 + 2√6.
        let [r2, r3, r6] = [2.0, 3.0, 6.0].map(|x| n::<8>(x).sqrt(&mut roots));
        assert_eq!((r2 * r3 - r6).sign().ok(), Some(0));
        let sum = r2 + r3;
        assert_eq!((sum * sum - n(5.0) - r6.doubled()).sign().ok(), Some(0));
        assert_eq!((sum * sum - n(5.0) - r6.doubled() + Ball::ZERO).sign().ok(), Some(0));
        // √4 is 2, without an error or a root.
        let two = n::<8>(4.0).sqrt(&mut roots);
        assert_eq!((two.error, two.roots), (Bound::ZERO, 0));
        // 2^400 (√2 √3 − √6) + 1 is not zero.
        let big = Ball::<8>::scaled(1.0, 400);
        assert_eq!((big * (r2 * r3 - r6) + n(1.0)).sign().ok(), Some(1));
        // In too few digits it is not known.
        let [r2, r3, r6] = [2.0, 3.0, 6.0].map(|x| n::<4>(x).sqrt(&mut roots));
        assert!((Ball::<4>::scaled(1.0, 300) * (r2 * r3 - r6)).sign().is_err());
    }
}
