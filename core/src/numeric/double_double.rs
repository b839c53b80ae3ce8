//! Double-double: a number as the unevaluated sum of two f64, about 106 bits.
//!
//! Dekker, *A floating-point technique for extending the available precision*, Numer. Math.
//! 18, 1971; the operations and their bounds from Joldes, Muller, Popescu, *Tight and rigorous
//! error bounds for basic building blocks of double-word arithmetic*, ACM TOMS 44(2), 2017:
//! below 3u² for sums, 7u² for products, 15u² for quotients and 4u² for roots, u = 2⁻⁵³, all of
//! it less than [`DoubleDouble::U`]. Products are split, not fused, so that every machine does
//! the same; what overflows on the way ends as NaN.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{Big, Real, Scalar, V3};

/// hi + lo, |lo| at most half a unit in the last place of hi.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(crate) struct DoubleDouble {
    pub(crate) hi: f64,
    pub(crate) lo: f64,
}

/// a + b exactly.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    let v = s - a;
    (s, (a - (s - v)) + (b - v))
}

/// a + b exactly, where |a| ≥ |b| or a = 0.
fn fast_two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    (s, b - (s - a))
}

/// The upper 26 bits and the rest.
fn split(a: f64) -> (f64, f64) {
    let c = 134_217_729.0 * a;
    let upper = c - (c - a);
    (upper, a - upper)
}

/// a · b exactly.
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let p = a * b;
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    (p, ((ah * bh - p) + ah * bl + al * bh) + al * bl)
}

impl DoubleDouble {
    fn of((hi, lo): (f64, f64)) -> Self {
        Self { hi, lo }
    }

    /// a − b exactly.
    pub(crate) fn difference(a: f64, b: f64) -> Self {
        Self::of(two_sum(a, -b))
    }

    /// The nearest to `x`.
    pub(crate) fn nearest<const N: usize>(x: &Big<N>) -> Self {
        let hi = x.to_f64();
        Self { hi, lo: if hi.is_finite() { (*x - Big::new(hi)).to_f64() } else { 0.0 } }
    }

    /// Times a power of two.
    pub(crate) fn scaled(self, by: f64) -> Self {
        Self { hi: self.hi * by, lo: self.lo * by }
    }

    fn is_above(self, o: Self) -> bool {
        self.hi > o.hi || (self.hi == o.hi && self.lo > o.lo)
    }
}

impl V3<DoubleDouble> {
    /// Each coordinate's nearest f64.
    pub(crate) fn to_f64(self) -> V3<f64> {
        V3 { x: self.x.hi, y: self.y.hi, z: self.z.hi }
    }
}

impl Add for DoubleDouble {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        let (sh, sl) = two_sum(self.hi, b.hi);
        let (th, tl) = two_sum(self.lo, b.lo);
        let (vh, vl) = fast_two_sum(sh, sl + th);
        Self::of(fast_two_sum(vh, tl + vl))
    }
}

impl Sub for DoubleDouble {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        self + -b
    }
}

impl Neg for DoubleDouble {
    type Output = Self;
    fn neg(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }
}

impl Mul for DoubleDouble {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        let (ch, cl) = two_product(self.hi, b.hi);
        Self::of(fast_two_sum(ch, cl + (self.hi * b.lo + self.lo * b.hi)))
    }
}

impl Div for DoubleDouble {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let th = self.hi / b.hi;
        let rest = self - b * Self::splat(th);
        Self::of(fast_two_sum(th, (rest.hi + rest.lo) / b.hi))
    }
}

impl Scalar for DoubleDouble {
    fn to_f64(self) -> f64 {
        self.hi
    }
}

impl Real for DoubleDouble {
    const U: f64 = super::U * super::U * 16.0;
    fn splat(x: f64) -> Self {
        Self { hi: x, lo: 0.0 }
    }
    fn sqrt(self) -> Self {
        if self.hi == 0.0 {
            return Self::splat(0.0);
        }
        let s = self.hi.sqrt();
        let rest = self - Self::of(two_product(s, s));
        Self::of(fast_two_sum(s, rest.hi / (2.0 * s)))
    }
    fn abs(self) -> Self {
        if self.hi < 0.0 { -self } else { self }
    }
    fn max(self, other: Self) -> Self {
        if self.is_above(other) { self } else { other }
    }
    fn min(self, other: Self) -> Self {
        if other.is_above(self) { self } else { other }
    }
    fn if_positive(self, a: Self, b: Self) -> Self {
        if self.hi > 0.0 { a } else { b }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wide(x: DoubleDouble) -> Big<8> {
        Big::new(x.hi) + Big::new(x.lo)
    }

    /// |x − y| ≤ U · |y|.
    fn close(x: DoubleDouble, y: Big<8>) -> bool {
        (wide(x) - y).abs() <= y.abs() * Big::new(DoubleDouble::U)
    }

    fn number() -> impl Strategy<Value = DoubleDouble> {
        (-1.0f64..1.0, -1.0f64..1.0, -40i32..40).prop_map(|(hi, lo, e)| {
            DoubleDouble::of(fast_two_sum(hi * 2f64.powi(e), lo * hi.abs() * 2f64.powi(e - 53)))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        /// Against 512-bit numbers.
        #[test]
        fn operations_keep_their_bound(a in number(), b in number()) {
            prop_assume!(a.hi != 0.0 && b.hi != 0.0);
            let (x, y) = (wide(a), wide(b));
            prop_assert!(close(a + b, x + y));
            // What is nearly equal cancels, exactly.
            let c = DoubleDouble { lo: b.lo, ..a };
            prop_assert!(close(a - c, x - wide(c)));
            prop_assert!(close(a * b, x * y));
            prop_assert!(close(a / b, x.over(y)));
            prop_assert!(close(a.abs().sqrt(), x.abs().sqrt()));
            prop_assert_eq!(a.max(b), if x > y { a } else { b });
            prop_assert_eq!(DoubleDouble::nearest(&x), a);
        }
    }
}
