//! Quotients and square roots of [`Big`] numbers.

use super::Big;
use super::big::{add, sub};

impl<const N: usize> Big<N> {
    /// self / divisor, truncated; zero where the divisor is zero.
    ///
    /// Long division by limbs (Knuth, *The Art of Computer Programming* 2, 4.3.1, algorithm D), each
    /// limb of the quotient found by an inverse.
    #[must_use]
    pub fn over(self, divisor: Self) -> Self {
        if self.is_zero() || divisor.is_zero() {
            return Self::ZERO;
        }
        let by = &divisor.limbs;
        // The limb `i` below the top, or what lies below all.
        let limb = |limbs: &[u64; N], i: usize, below: u64| match i {
            _ if i < N => limbs[N - 1 - i],
            _ if i == N => below,
            _ => 0,
        };
        let inverse = Inverse::new(by[N - 1], limb(by, 1, 0));
        // The rest stays below the divisor: a greater dividend is halved first.
        let (mut rest, mut below, mut exponent) = (self.limbs, 0, self.exponent - divisor.exponent);
        if !rest.iter().rev().lt(by.iter().rev()) {
            below = rest[0] << 63;
            for i in 0..N - 1 {
                rest[i] = (rest[i] >> 1) | (rest[i + 1] << 63);
            }
            rest[N - 1] >>= 1;
            exponent += 1;
        }
        let mut limbs = [0; N];
        for digit in limbs.iter_mut().rev() {
            let mut q = inverse.quotient([rest[N - 1], limb(&rest, 1, below), limb(&rest, 2, below)]);
            // The rest, one limb up, less q times the divisor.
            let (mut carry, mut borrow) = (0, false);
            let mut shifted = below;
            for i in 0..N {
                let t = u128::from(q) * u128::from(by[i]) + u128::from(carry);
                carry = (t >> 64) as u64;
                let above = rest[i];
                (rest[i], borrow) = sub(shifted, t as u64, borrow);
                shifted = above;
            }
            let (mut top, _) = sub(shifted, carry, borrow);
            // The two top limbs alone may give one too many.
            while top != 0 {
                q -= 1;
                let mut carry = false;
                for i in 0..N {
                    (rest[i], carry) = add(rest[i], by[i], carry);
                }
                top = top.wrapping_add(u64::from(carry));
            }
            *digit = q;
            below = 0;
        }
        Self { negative: self.negative != divisor.negative, exponent, limbs }
    }

    /// 1 / self; zero for zero.
    #[must_use]
    pub fn reciprocal(self) -> Self {
        Self::new(1.0).over(self)
    }

    /// The square root of a number in [1/4, 1), to 126 bits.
    fn near_root(&self) -> Self {
        let [low, high] = [if N > 1 { self.limbs[N.saturating_sub(2)] } else { 0 }, self.limbs[N - 1]];
        let square = (u128::from(high) << 64 | u128::from(low)) >> -self.exponent;
        // The whole root of `square`, first as f64s have it.
        let mut s = (((square >> 64) as f64).sqrt() * f64::from_bits((1023 + 32) << 52)) as u64;
        let lack = |s: u64| square.wrapping_sub(u128::from(s) * u128::from(s)) as i128;
        s = s.saturating_add_signed((lack(s) as f64 / (2.0 * s as f64)) as i64);
        while lack(s) < 0 {
            s -= 1;
        }
        // What it lacks is the rest over twice the root.
        let root = (u128::from(s) << 63) + ((lack(s) as u128) << 62) / u128::from(s);
        let up = root.leading_zeros();
        let (root, mut limbs) = (root << up, [0; N]);
        limbs[N - 1] = (root >> 64) as u64;
        if N > 1 {
            limbs[N.saturating_sub(2)] = root as u64;
        }
        Self { negative: false, exponent: 1 - i64::from(up), limbs }
    }

    /// The square root of `self`; zero where it is negative.
    #[must_use]
    pub fn sqrt(self) -> Self {
        if self.is_zero() || self.negative {
            return Self::ZERO;
        }
        let half_power = self.exponent - self.exponent.div_euclid(2);
        let unit = self.scale(-2 * half_power); // in [1/4, 1)
        // Heron's rule: twice the digits each time.
        let (mut root, mut right) = (unit.near_root(), 126);
        while right < 64 * N - 8 {
            root = (root + unit.over(root)).scale(-1);
            right *= 2;
        }
        root.scale(half_power)
    }
}

/// A divisor's two top limbs, the higher one's top bit set, and (2^192 − 1) / divisor − 2^64.
///
/// Möller, Granlund, *Improved division by invariant integers*, IEEE Trans. Comput. 60, 2011.
struct Inverse {
    divisor: u128,
    inverse: u64,
}

impl Inverse {
    #[inline(always)]
    fn new(high: u64, low: u64) -> Self {
        let mut v = ((u128::from(!high) << 64 | u128::from(u64::MAX)) / u128::from(high)) as u64;
        let (mut p, over) = high.wrapping_mul(v).overflowing_add(low);
        if over {
            v -= 1;
            if p >= high {
                v -= 1;
                p = p.wrapping_sub(high);
            }
            p = p.wrapping_sub(high);
        }
        let t = u128::from(v) * u128::from(low);
        let (p, over) = p.overflowing_add((t >> 64) as u64);
        let divisor = u128::from(high) << 64 | u128::from(low);
        if over {
            v -= 1;
            if (u128::from(p) << 64 | u128::from(t as u64)) >= divisor {
                v -= 1;
            }
        }
        Self { divisor, inverse: v }
    }

    /// The three limbs, the highest first, over the divisor: at most 2^64 − 1.
    #[inline(always)]
    fn quotient(&self, [u2, u1, u0]: [u64; 3]) -> u64 {
        let (d, top) = (self.divisor, u128::from(u2) << 64 | u128::from(u1));
        if top >= d {
            return u64::MAX;
        }
        let q = (u128::from(self.inverse) * u128::from(u2)).wrapping_add(top);
        let (mut q1, q0) = ((q >> 64) as u64, q as u64);
        let r1 = u1.wrapping_sub(q1.wrapping_mul((d >> 64) as u64));
        let t = u128::from(d as u64) * u128::from(q1);
        let mut r = (u128::from(r1) << 64 | u128::from(u0)).wrapping_sub(t).wrapping_sub(d);
        q1 = q1.wrapping_add(1);
        if (r >> 64) as u64 >= q0 {
            q1 = q1.wrapping_sub(1);
            r = r.wrapping_add(d);
        }
        if r >= d { q1.wrapping_add(1) } else { q1 }
    }
}

#[cfg(test)]
mod tests {
    use dashu_float::FBig;
    use dashu_float::round::mode::Zero;
    use proptest::prelude::*;

    use super::*;

    type F = FBig<Zero, 2>;

    /// Limbs as they are hardest on division: all bits, none, or one.
    fn limbs() -> impl Strategy<Value = Vec<u64>> {
        let limb = prop_oneof![Just(0), Just(1), Just(1 << 63), Just(u64::MAX - 1), Just(u64::MAX), any::<u64>()];
        prop::collection::vec(limb, 24)
    }

    fn number<const N: usize>(limbs: &[u64], exponent: i64) -> Big<N> {
        let mut limbs: [u64; N] = std::array::from_fn(|i| limbs[i]);
        limbs[N - 1] |= 1 << 63;
        Big { negative: false, exponent, limbs }
    }

    fn exact<const N: usize>(x: &Big<N>) -> F {
        let wide = |l: u64| F::from(l).with_precision(8192).value();
        let sum = (0..N).fold(wide(0), |sum, i| sum + (wide(x.limbs[i]) << (64 * i as isize)));
        sum << (x.exponent - 64 * N as i64) as isize
    }

    fn holds<const N: usize>(n: &[u64], d: &[u64], exponent: i64) {
        let (n, d) = (number::<N>(n, exponent), number::<N>(d, 0));
        let q = n.over(d);
        let unit = F::ONE.with_precision(8192).value() << (q.exponent - 64 * N as i64) as isize;
        assert!(exact(&q) * exact(&d) <= exact(&n), "{n:?} / {d:?} is too large");
        assert!((exact(&q) + unit) * exact(&d) > exact(&n), "{n:?} / {d:?} is too small");
        let root = n.sqrt();
        let slack = exact(&root) >> (64 * N as isize - 8);
        let (low, high) = (exact(&root) - &slack, exact(&root) + &slack);
        assert!(&low * &low <= exact(&n) && exact(&n) <= &high * &high, "the root of {n:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3_000))]
        #[test]
        fn quotients_and_roots_of_any_limbs_hold_what_they_promise(n in limbs(), d in limbs(), exponent in -5i64..5) {
            holds::<4>(&n, &d, exponent);
            holds::<8>(&n, &d, exponent);
            holds::<24>(&n, &d, exponent);
        }
    }
}
