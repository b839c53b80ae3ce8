//! Numbers of many bits that know how wrong they may be.

use std::cmp::Ordering;
use std::ops::{Add, Mul, Neg, Sub};

use dashu_float::round::mode::HalfEven;
use dashu_float::{Context, FBig};

pub(crate) type Float = FBig<HalfEven, 2>;

/// An upper bound m · 2^e of an error; m is 0 or in [1, 2).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bound {
    m: f64,
    e: i64,
}

/// Above every rounding of the few f64 operations that make a bound.
const SLACK: f64 = 1.0 + 1e-12;

impl Bound {
    const ZERO: Self = Self { m: 0.0, e: 0 };

    fn new(m: f64, e: i64) -> Self {
        if m == 0.0 {
            return Self::ZERO;
        }
        let shift = libm::ilogb(m);
        Self { m: libm::scalbn(m, -shift) * SLACK, e: e + i64::from(shift) }
    }

    /// At least |x|, at most twice that.
    fn above(x: &Float) -> Self {
        let r = x.repr();
        if r.significand().is_zero() { Self::ZERO } else { Self { m: 1.0, e: r.exponent() as i64 + r.digits() as i64 } }
    }

    fn plus(self, o: Self) -> Self {
        let (big, small) = if self.m == 0.0 || (o.m != 0.0 && o.e > self.e) { (o, self) } else { (self, o) };
        if small.m == 0.0 {
            return big;
        }
        let gap = (big.e - small.e).min(100) as i32;
        Self::new(big.m + libm::scalbn(small.m, -gap), big.e)
    }

    fn times(self, o: Self) -> Self {
        Self::new(self.m * o.m, self.e + o.e)
    }

    /// `self` / x for x not zero, from above.
    fn over(self, x: &Float) -> Self {
        // |x| is at least half of `above`.
        Self::new(self.m, self.e - (Self::above(x).e - 1))
    }

    fn shifted(self, by: i64) -> Self {
        Self::new(self.m, self.e + by)
    }

    fn log2(self) -> f64 {
        if self.m == 0.0 { f64::NEG_INFINITY } else { libm::log2(self.m) + self.e as f64 }
    }
}

/// A real number, known as a float of some precision and a proven bound of its error.
#[derive(Clone, Debug)]
pub struct Ball {
    mid: Float,
    error: Bound,
    bits: usize,
}

impl Ball {
    /// `x` exactly; operations on it round to `bits` bits.
    ///
    /// # Panics
    /// When `x` is not finite.
    #[must_use]
    pub fn exact(x: f64, bits: usize) -> Self {
        let mid = Float::try_from(x + 0.0).unwrap_or_else(|_| panic!("{x} is not finite"));
        Self { mid: mid.with_precision(bits).value(), error: Bound::ZERO, bits }
    }

    /// Zero exactly.
    #[must_use]
    pub fn zero(bits: usize) -> Self {
        Self::exact(0.0, bits)
    }

    fn rounded(result: dashu_float::FpResult<Float>, error: Bound, bits: usize) -> Self {
        // Exponents are of machine-word size and every divisor and radicand was decided before.
        let (mid, exact) = result.unwrap_or_else(|e| unreachable!("{e:?}")).value_with_exact();
        let error = if exact { error } else { error.plus(Bound::above(&mid).shifted(1 - bits as i64)) };
        Self { mid, error, bits }
    }

    fn context(&self) -> Context<HalfEven> {
        Context::new(self.bits)
    }

    /// Below, at or above zero; at zero where the error leaves it open: a tie.
    #[must_use]
    pub fn sign(&self) -> Ordering {
        let error = self.error;
        let significand = self.mid.repr().significand();
        // |x| is at least 2^(e−1) where `above` says 2^e.
        if significand.is_zero() || (error.m != 0.0 && error.e + 1 >= Bound::above(&self.mid).e - 1) {
            return Ordering::Equal;
        }
        if self.mid > Float::ZERO { Ordering::Greater } else { Ordering::Less }
    }

    /// How many bits the value stands above its error; infinite where it is exact.
    #[must_use]
    pub fn margin(&self) -> f64 {
        self.log2() - self.error.log2()
    }

    /// log₂|x|, from below by at most 1.
    fn log2(&self) -> f64 {
        let b = Bound::above(&self.mid);
        if b.m == 0.0 { f64::NEG_INFINITY } else { b.e as f64 - 1.0 }
    }

    /// Whether nothing was rounded on the way to this value.
    #[must_use]
    pub fn is_exact(&self) -> bool {
        self.error.m == 0.0
    }

    /// The nearest f64.
    #[must_use]
    pub fn to_f64(&self) -> f64 {
        self.mid.to_f64().value()
    }

    /// The value less the greatest integer not above it, as an f64 in [0, 1].
    #[must_use]
    pub fn fraction(&self) -> f64 {
        let floor = self.mid.clone().with_precision(0).value().floor();
        (self.mid.clone().with_precision(0).value() - floor).to_f64().value()
    }

    /// Twice the value.
    #[must_use]
    pub fn doubled(&self) -> Self {
        self + self
    }

    /// The square root; of what is not above zero, zero.
    #[must_use]
    pub fn sqrt(&self) -> Self {
        if self.sign() != Ordering::Greater {
            return Self::zero(self.bits);
        }
        let root = Self::rounded(self.context().sqrt(self.mid.repr()), Bound::ZERO, self.bits);
        let error = root.error.plus(self.error.over(&root.mid));
        Self { error, ..root }
    }

    /// The quotient; the divisor must have a sign.
    ///
    /// # Panics
    /// When the divisor may be zero.
    #[must_use]
    pub fn over(&self, o: &Self) -> Self {
        assert_ne!(o.sign(), Ordering::Equal, "division by what may be zero");
        let q = Self::rounded(self.context().div(self.mid.repr(), o.mid.repr()), Bound::ZERO, self.bits);
        // |a/b − (a+α)/(b+β)| ≤ (|α| + |a/b||β|)/(|b| − |β|); a divisor with a sign whose error
        // is above half of it never occurs in a scene that 512 bits can tell apart.
        assert!(o.margin() > 1.0, "division by what is hardly told from zero");
        let top = self.error.plus(Bound::above(&q.mid).times(o.error));
        let error = q.error.plus(top.over(&o.mid).shifted(i64::from(!o.is_exact())));
        Self { error, ..q }
    }
}

impl Add for &Ball {
    type Output = Ball;
    fn add(self, o: Self) -> Ball {
        Ball::rounded(self.context().add(self.mid.repr(), o.mid.repr()), self.error.plus(o.error), self.bits)
    }
}

impl Sub for &Ball {
    type Output = Ball;
    fn sub(self, o: Self) -> Ball {
        Ball::rounded(self.context().sub(self.mid.repr(), o.mid.repr()), self.error.plus(o.error), self.bits)
    }
}

impl Mul for &Ball {
    type Output = Ball;
    fn mul(self, o: Self) -> Ball {
        let cross = if self.is_exact() && o.is_exact() {
            Bound::ZERO
        } else {
            let a = Bound::above(&self.mid).times(o.error);
            let b = Bound::above(&o.mid).times(self.error);
            a.plus(b).plus(self.error.times(o.error))
        };
        Ball::rounded(self.context().mul(self.mid.repr(), o.mid.repr()), cross, self.bits)
    }
}

impl Neg for &Ball {
    type Output = Ball;
    fn neg(self) -> Ball {
        Ball { mid: -self.mid.clone(), error: self.error, bits: self.bits }
    }
}

/// Three of them.
#[derive(Clone, Debug)]
pub struct Vector(pub [Ball; 3]);

impl Vector {
    /// The vector exactly.
    #[must_use]
    pub fn exact(v: glam::DVec3, bits: usize) -> Self {
        Self(v.to_array().map(|x| Ball::exact(x, bits)))
    }

    /// The inner product.
    #[must_use]
    pub fn dot(&self, o: &Self) -> Ball {
        let [a, b, c] = [0, 1, 2].map(|i| &self.0[i] * &o.0[i]);
        &(&a + &b) + &c
    }

    /// The outer product by the usual formula.
    #[must_use]
    pub fn cross(&self, o: &Self) -> Self {
        let term = |i: usize, j: usize| &(&self.0[i] * &o.0[j]) - &(&self.0[j] * &o.0[i]);
        Self([term(1, 2), term(2, 0), term(0, 1)])
    }

    /// Every component times k.
    #[must_use]
    pub fn times(&self, k: &Ball) -> Self {
        Self([0, 1, 2].map(|i| &self.0[i] * k))
    }

    /// Every component through k, which must have a sign.
    #[must_use]
    pub fn over(&self, k: &Ball) -> Self {
        Self([0, 1, 2].map(|i| self.0[i].over(k)))
    }

    /// The Euclidean length.
    #[must_use]
    pub fn length(&self) -> Ball {
        self.dot(self).sqrt()
    }
}

impl Add for &Vector {
    type Output = Vector;
    fn add(self, o: Self) -> Vector {
        Vector([0, 1, 2].map(|i| &self.0[i] + &o.0[i]))
    }
}

impl Sub for &Vector {
    type Output = Vector;
    fn sub(self, o: Self) -> Vector {
        Vector([0, 1, 2].map(|i| &self.0[i] - &o.0[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_exact_stays_exact() {
        let (a, b) = (Ball::exact(1e300, 4096), Ball::exact(5e-324, 4096));
        let sum = &a + &b;
        assert!(sum.is_exact());
        assert_eq!((&sum - &a).to_f64(), 5e-324);
        let three = Ball::exact(3.0, 512);
        assert!((&three * &three).sqrt().is_exact());
        assert!(!three.sqrt().is_exact());
        assert!(!Ball::exact(1.0, 512).over(&three).is_exact());
    }

    #[test]
    fn equal_by_different_ways_is_a_tie_and_less_than_its_error_is_not() {
        let [one, two, three] = [1.0, 2.0, 3.0].map(|x| Ball::exact(x, 512));
        let root = two.sqrt();
        assert_eq!((&(&root * &root) - &two).sign(), Ordering::Equal);
        let third = one.over(&three);
        assert_eq!((&(&third * &three) - &one).sign(), Ordering::Equal);
        let tiny = Ball::exact(2f64.powi(-400), 512);
        assert_eq!((&(&(&third * &three) - &one) + &tiny).sign(), Ordering::Greater);
        assert_eq!((&(&(&root * &root) - &two) - &tiny).sign(), Ordering::Less);
    }

    #[test]
    fn fractions_are_of_the_floor() {
        assert_eq!(Ball::exact(-0.25, 512).fraction(), 0.75);
        assert_eq!((&Ball::exact(1e300, 2048) + &Ball::exact(0.5, 2048)).fraction(), 0.5);
        assert_eq!(Ball::exact(7.0, 512).fraction(), 0.0);
    }
}
