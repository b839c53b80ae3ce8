//! Upper bounds of errors, beside [`Big`] numbers and of the same reach.

use super::Big;

/// m · 2^e, not less than some error; m is 0 or in [1/2, 1). A bound only ever grows by rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bound {
    m: f64,
    e: i64,
}

/// Above the roundings of any operation here, and of a [`Big`]'s leading limb.
const UP: f64 = 1.0 + 1e-15;

/// The exponent of a bound that bounds nothing; sums and products stay there.
const BEYOND: i64 = 1 << 50;

impl Bound {
    pub(crate) const ZERO: Self = Self { m: 0.0, e: 0 };

    fn new(m: f64, e: i64) -> Self {
        if m == 0.0 {
            return Self::ZERO;
        }
        // m is a normal number: factors lie in [1/2, 4).
        let shift = ((m.to_bits() >> 52) as i64) - 1022;
        let m = f64::from_bits((m.to_bits() & ((1 << 52) - 1)) | (1022 << 52));
        Self { m, e: (e + shift).min(BEYOND) }
    }

    /// 2^k.
    pub(crate) fn power(k: i64) -> Self {
        Self { m: 0.5, e: k + 1 }
    }

    /// What a number of N limbs may lose by one operation, as a share of it.
    pub(crate) fn rounding<const N: usize>() -> Self {
        Self::power(8 - 64 * N as i64)
    }

    /// |x|.
    pub(crate) fn of<const N: usize>(x: &Big<N>) -> Self {
        if x.is_zero() { Self::ZERO } else { Self::new(x.leading() * UP, x.exponent()) }
    }

    /// e with the bound below 2^e; `i64::MIN` for zero.
    pub(crate) fn exponent(self) -> i64 {
        if self.m == 0.0 { i64::MIN } else { self.e }
    }

    /// The bound · 2^k.
    pub(crate) fn scale(self, k: i64) -> Self {
        if self.m == 0.0 { self } else { Self { e: self.e + k, ..self } }
    }

    /// The bound / |x|; x = 0 makes it greater than anything, unless there is no error.
    pub(crate) fn over<const N: usize>(self, x: &Big<N>) -> Self {
        if self.m == 0.0 {
            self
        } else if x.is_zero() {
            Self::power(BEYOND)
        } else {
            Self::new(self.m / x.leading() * UP, self.e - x.exponent())
        }
    }
}

impl std::ops::Add for Bound {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        let (big, small) = if self.exponent() >= o.exponent() { (self, o) } else { (o, self) };
        if small.m == 0.0 {
            return big;
        }
        let gap = (big.e - small.e).min(100) as u64;
        Self::new((big.m + small.m * f64::from_bits((1023 - gap) << 52)) * UP, big.e)
    }
}

impl std::ops::Mul for Bound {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        if self.m == 0.0 || o.m == 0.0 { Self::ZERO } else { Self::new(self.m * o.m * UP, self.e + o.e) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(b: Bound) -> f64 {
        b.m * 2f64.powi(b.e as i32)
    }

    #[test]
    fn bounds_are_never_below_and_hardly_above() {
        let all = [1.0, 1.5, 0.1, 3e-9, 7e12, 1.0 + f64::EPSILON];
        let of = |x: f64| Bound::of(&Big::<4>::new(x));
        for a in all {
            for b in all {
                for (bound, real) in
                    [(of(a) + of(b), a + b), (of(a) * of(b), a * b), (of(a).over(&Big::<4>::new(-b)), a / b)]
                {
                    assert!(value(bound) >= real && value(bound) <= real * (1.0 + 1e-13), "{a} {b}");
                    assert!(2f64.powi(bound.exponent() as i32) >= value(bound));
                    assert!(2f64.powi(bound.exponent() as i32 - 1) <= value(bound));
                }
            }
        }
    }

    #[test]
    fn nothing_stays_nothing_and_beyond_all_is_beyond_all() {
        let zero = Big::<4>::ZERO;
        assert_eq!(Bound::ZERO.over(&zero), Bound::ZERO);
        assert_eq!(Bound::ZERO * Bound::power(900), Bound::ZERO);
        assert_eq!((Bound::ZERO + Bound::power(-3)).exponent(), -2);
        assert!(Bound::power(-3000).over(&zero).exponent() > 1 << 40);
        // What is far smaller still counts.
        let sum = Bound::power(0) + Bound::power(-5000);
        assert!(value(sum) > 1.0);
    }
}
