//! A binary floating-point number of a fixed, large precision and a practically unbounded exponent.
//!
//! Every operation truncates its exact result to 64·N bits, so its relative error is
//! below 2^(8−64N). There is no overflow, no underflow, no NaN and no infinity: what
//! real arithmetic leaves undefined (division by zero, the root of a negative number)
//! gives zero, and callers ask first.

use std::cmp::Ordering;
use std::hint::select_unpredictable;
use std::ops::{Add, Mul, Neg, Sub};

/// ± mantissa · 2^(exponent − 64·N), the mantissa's top bit set; zero has an all-zero mantissa.
/// Limbs are stored least significant first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Big<const N: usize> {
    pub(super) negative: bool,
    pub(super) exponent: i64,
    pub(super) limbs: [u64; N],
}

impl<const N: usize> Big<N> {
    /// Zero.
    pub const ZERO: Self = Self { negative: false, exponent: 0, limbs: [0; N] };

    /// `x` exactly; `x` must be finite.
    #[must_use]
    pub fn new(x: f64) -> Self {
        debug_assert!(x.is_finite());
        if x == 0.0 || !x.is_finite() {
            return Self::ZERO;
        }
        let bits = x.to_bits();
        let biased = ((bits >> 52) & 0x7ff) as i64;
        let fraction = bits & ((1 << 52) - 1);
        let (mantissa, power) = if biased == 0 { (fraction, -1074) } else { (fraction | (1 << 52), biased - 1075) };
        let shift = mantissa.leading_zeros();
        let mut limbs = [0; N];
        limbs[N - 1] = mantissa << shift;
        Self { negative: x < 0.0, exponent: power + 64 - i64::from(shift), limbs }
    }

    /// The same number in M limbs, truncated or padded with zeros.
    #[must_use]
    pub fn resize<const M: usize>(&self) -> Big<M> {
        let mut limbs = [0; M];
        let n = N.min(M);
        limbs[M - n..].copy_from_slice(&self.limbs[N - n..]);
        Big { negative: self.negative, exponent: self.exponent, limbs }
    }

    /// Whether this is zero.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        self.limbs[N - 1] == 0
    }

    /// −1, 0 or 1.
    #[must_use]
    pub fn signum(&self) -> i32 {
        if self.is_zero() {
            0
        } else if self.negative {
            -1
        } else {
            1
        }
    }

    /// The absolute value.
    #[must_use]
    pub fn abs(self) -> Self {
        Self { negative: false, ..self }
    }

    /// e with 2^(e−1) ≤ |self| < 2^e; `i64::MIN` for zero.
    #[must_use]
    pub fn exponent(&self) -> i64 {
        if self.is_zero() { i64::MIN } else { self.exponent }
    }

    /// How many of the mantissa's low bits are zero; all of them for zero.
    pub(crate) fn trailing_zeros(&self) -> i64 {
        let empty = self.limbs.iter().take_while(|&&l| l == 0).count();
        64 * empty as i64 + self.limbs.get(empty).map_or(0, |l| i64::from(l.trailing_zeros()))
    }

    /// |self| / 2^exponent, in [1/2, 1], to f64's precision; 0 for zero.
    pub(crate) fn leading(&self) -> f64 {
        // 2^−64 · the top limb.
        self.limbs[N - 1] as f64 * f64::from_bits((1023 - 64) << 52)
    }

    /// self · 2^k, exactly.
    #[must_use]
    pub fn scale(self, k: i64) -> Self {
        if self.is_zero() { self } else { Self { exponent: self.exponent + k, ..self } }
    }

    /// self − ⌊self⌋, in [0, 1): exact, save that 1 less a fraction below 2^−64N is rounded down.
    #[must_use]
    pub fn fraction(&self) -> Self {
        if self.is_zero() || self.exponent >= 64 * N as i64 {
            return Self::ZERO;
        }
        let mut part = *self;
        part.negative = false;
        if self.exponent > 0 {
            // The top `exponent` bits are the whole part.
            let (limbs, bits) = ((self.exponent / 64) as usize, self.exponent % 64);
            for limb in &mut part.limbs[N - limbs..] {
                *limb = 0;
            }
            if bits > 0 {
                part.limbs[N - 1 - limbs] &= u64::MAX >> bits;
            }
            let Some(top) = (0..N).rev().find(|&i| part.limbs[i] != 0) else { return Self::ZERO };
            let shift = 64 * (N - 1 - top) + part.limbs[top].leading_zeros() as usize;
            part.limbs = shift_left(&part.limbs, shift);
            part.exponent -= shift as i64;
        }
        if self.negative { Self::new(1.0) - part } else { part }
    }

    /// The nearest f64, ties to even; ±inf beyond f64's range.
    #[must_use]
    pub fn to_f64(&self) -> f64 {
        if self.is_zero() {
            return 0.0;
        }
        let sign = if self.negative { 1u64 << 63 } else { 0 };
        if self.exponent > 1024 {
            return f64::from_bits(sign | f64::INFINITY.to_bits());
        }
        // Bits kept: 53, fewer where the result is denormal.
        let keep = 53.min(self.exponent + 1074);
        if keep < 0 {
            return f64::from_bits(sign);
        }
        let top = self.limbs[N - 1];
        let sticky = u64::from(self.limbs[..N - 1].iter().any(|&l| l != 0));
        // `value` = top with the sticky bit folded into its last bit; rounding looks at bits below `keep`.
        let value = top | sticky;
        let drop = 64 - keep as u32; // 11 ..= 64
        let (mut kept, rest, half) = if drop == 64 {
            (0, u128::from(value), 1u128 << 63)
        } else {
            (value >> drop, u128::from(value & ((1 << drop) - 1)), 1u128 << (drop - 1))
        };
        if rest > half || (rest == half && kept & 1 == 1) {
            kept += 1;
        }
        // kept · 2^(exponent − keep); assembling by addition lets a carry raise the exponent.
        let bits = if keep == 53 { (((self.exponent + 1021) as u64) << 52) + kept } else { kept };
        if bits >= f64::INFINITY.to_bits() {
            return f64::from_bits(sign | f64::INFINITY.to_bits());
        }
        f64::from_bits(sign | bits)
    }

    fn cmp_magnitude(&self, other: &Self) -> Ordering {
        match (self.is_zero(), other.is_zero()) {
            (true, true) => return Ordering::Equal,
            (true, false) => return Ordering::Less,
            (false, true) => return Ordering::Greater,
            (false, false) => {}
        }
        self.exponent.cmp(&other.exponent).then_with(|| self.limbs.iter().rev().cmp(other.limbs.iter().rev()))
    }

    /// The limbs of `self` shifted down by `gap` ≤ 64·N bits, and a guard limb below them.
    #[inline(always)]
    fn aligned(&self, gap: u64) -> (u64, [u64; N]) {
        let bit = (gap % 64) as u32;
        // In two steps, so that a shift by nothing takes nothing from the limb above.
        let join = |low: u64, high: u64| (low >> bit) | ((high << 1) << (63 ^ bit));
        let at = |i: usize| if i < N { self.limbs[i] } else { 0 };
        if gap < 64 {
            return (join(0, self.limbs[0]), std::array::from_fn(|i| join(self.limbs[i], at(i + 1))));
        }
        let limb = (gap / 64) as usize;
        (join(at(limb - 1), at(limb)), std::array::from_fn(|i| join(at(i + limb), at(i + limb + 1))))
    }

    /// self + other, or self − other where asked to `subtract`: without branches on signs or on which is greater,
    /// which no processor foresees.
    fn sum(&self, other: &Self, subtract: bool) -> Self {
        let negative = other.negative != subtract;
        if self.is_zero() {
            return if other.is_zero() { Self::ZERO } else { Self { negative, ..*other } };
        }
        if other.is_zero() {
            return *self;
        }
        let key = |x: &Self| i128::from(x.exponent) << 64 | i128::from(x.limbs[N - 1]);
        let (a, b) = (key(self), key(other));
        let less = if a == b { self.cmp_magnitude(other) == Ordering::Less } else { a < b };
        let big = select_unpredictable(less, other, self);
        let small = select_unpredictable(less, self, other);
        let sign = select_unpredictable(less, negative, self.negative);
        let gap = (big.exponent - small.exponent) as u64;
        if gap > 64 * N as u64 {
            return Self { negative: sign, ..*big };
        }
        // A difference adds the complement. Its guard limb keeps the error below a unit of the last place.
        let differ = self.negative != negative;
        let flip = if differ { u64::MAX } else { 0 };
        let (guard, mut limbs) = small.aligned(gap);
        let (low, mut carry) = add(guard ^ flip, 0, differ);
        for i in 0..N {
            (limbs[i], carry) = add(big.limbs[i], limbs[i] ^ flip, carry);
        }
        Self::normal(sign, big.exponent, carry && !differ, limbs, low)
    }

    fn product(&self, other: &Self) -> Self {
        if self.is_zero() || other.is_zero() {
            return Self::ZERO;
        }
        // Columns below N − 1 cannot reach the kept limbs but for a carry of under 2N units of the guard.
        let mut columns = [[0u64; 2]; N];
        let product = &mut columns.as_flattened_mut()[..2 * N];
        let mut row = |i: usize| {
            let mut carry = 0u64;
            for j in (N - 1).saturating_sub(i)..N {
                let t = u128::from(self.limbs[i]) * u128::from(other.limbs[j])
                    + u128::from(product[i + j])
                    + u128::from(carry);
                product[i + j] = t as u64;
                carry = (t >> 64) as u64;
            }
            product[i + N] = carry;
        };
        // A number of the scene has one limb: callers put it first.
        if self.limbs[..N - 1].iter().any(|&l| l != 0) {
            (0..N - 1).for_each(&mut row);
        }
        row(N - 1);
        // The top bit is the highest or the one below it: then everything is doubled.
        let small = product[2 * N - 1] >> 63 == 0;
        let again = if small { u64::MAX } else { 0 };
        let mut carry = small && product[N - 1] >> 63 == 1;
        let mut limbs = [0; N];
        for i in 0..N {
            (limbs[i], carry) = add(product[N + i], product[N + i] & again, carry);
        }
        let exponent = self.exponent + other.exponent - i64::from(small);
        Self { negative: self.negative != other.negative, exponent, limbs }
    }

    /// The number of these limbs, `carry` above and `low` below them, its top bit brought to its place.
    #[inline(always)]
    fn normal(negative: bool, mut exponent: i64, carry: bool, mut limbs: [u64; N], mut low: u64) -> Self {
        if limbs[N - 1] == 0 && !carry {
            let Some(top) = limbs.iter().rposition(|&l| l != 0).map(|i| i + 1).or((low != 0).then_some(0)) else {
                return Self::ZERO;
            };
            let skip = N - top;
            let below = |i: usize| match i + 1 {
                i if i > skip => limbs[i - 1 - skip],
                i if i == skip => low,
                _ => 0,
            };
            limbs = std::array::from_fn(below);
            low = 0;
            exponent -= 64 * skip as i64;
        }
        // With a carry, down by one bit: up by 63 from a limb further up.
        let up = select_unpredictable(carry, 63, limbs[N - 1].leading_zeros());
        let from = |i: usize| match i {
            0 => low,
            _ if i <= N => limbs[i - 1],
            _ => 1,
        };
        let limbs = std::array::from_fn(|i| {
            let high = select_unpredictable(carry, from(i + 2), from(i + 1));
            let low = select_unpredictable(carry, from(i + 1), from(i));
            (high << up) | ((low >> 1) >> (63 ^ up))
        });
        Self { negative, exponent: exponent + 64 * i64::from(carry) - i64::from(up), limbs }
    }
}

/// a + b + carry.
#[inline(always)]
pub(super) fn add(a: u64, b: u64, carry: bool) -> (u64, bool) {
    let (s, c1) = a.overflowing_add(b);
    let (s, c2) = s.overflowing_add(u64::from(carry));
    (s, c1 | c2)
}

/// a − b − borrow.
#[inline(always)]
pub(super) fn sub(a: u64, b: u64, borrow: bool) -> (u64, bool) {
    let (s, b1) = a.overflowing_sub(b);
    let (s, b2) = s.overflowing_sub(u64::from(borrow));
    (s, b1 | b2)
}

/// `limbs` shifted up by `by` bits.
fn shift_left<const N: usize>(limbs: &[u64; N], by: usize) -> [u64; N] {
    let (limb, bit) = (by / 64, by % 64);
    let mut out = [0; N];
    for i in limb..N {
        let high = limbs[i - limb] << bit;
        let low = if bit > 0 && i > limb { limbs[i - limb - 1] >> (64 - bit) } else { 0 };
        out[i] = high | low;
    }
    out
}

impl<const N: usize> Neg for Big<N> {
    type Output = Self;
    fn neg(self) -> Self {
        Self { negative: !self.negative, ..self }
    }
}

impl<const N: usize> Add for Big<N> {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        self.sum(&other, false)
    }
}

impl<const N: usize> Sub for Big<N> {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self.sum(&other, true)
    }
}

impl<const N: usize> Mul for Big<N> {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        self.product(&other)
    }
}

impl<const N: usize> PartialOrd for Big<N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<const N: usize> Ord for Big<N> {
    fn cmp(&self, other: &Self) -> Ordering {
        match self.signum().cmp(&other.signum()) {
            Ordering::Equal if self.signum() < 0 => other.cmp_magnitude(self),
            Ordering::Equal => self.cmp_magnitude(other),
            unequal => unequal,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dashu_float::FBig;
    use dashu_float::round::mode::Zero;
    use proptest::prelude::*;

    type B = Big<8>;
    type F = FBig<Zero, 2>;

    fn oracle(x: f64) -> F {
        F::try_from(x).expect("finite").with_precision(4096).value()
    }

    /// |a − b| ≤ 2^−500 |b|, `a` brought over limb by limb.
    fn close(a: B, b: F) -> bool {
        let mut sum = F::ZERO.with_precision(4096).value();
        for (i, &l) in a.limbs.iter().enumerate() {
            let l = F::from(l).with_precision(4096).value();
            sum += l << (64 * i as isize);
        }
        let mut v = sum << (a.exponent as isize - 512);
        if a.negative {
            v = -v;
        }
        let d = v - b.clone();
        let d = if d < F::ZERO { -d } else { d };
        let m = if b < F::ZERO { -b } else { b };
        d <= (m >> 500)
    }

    fn any_finite() -> impl Strategy<Value = f64> {
        prop_oneof![
            any::<f64>().prop_filter("finite", |x| x.is_finite()),
            -1e3..1e3f64,
            (1i32..1000).prop_map(f64::from),
            (0i32..60, 0i32..60).prop_map(|(a, b)| 2f64.powi(a) + 2f64.powi(-b)),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn arithmetic_agrees_with_a_wider_library(a in any_finite(), b in any_finite(), c in any_finite(), d in any_finite()) {
            let (ba, bb, bc, bd) = (B::new(a), B::new(b), B::new(c), B::new(d));
            let (fa, fb, fc, fd) = (oracle(a), oracle(b), oracle(c), oracle(d));
            prop_assert_eq!(ba.to_f64(), a);
            let (s, fs) = (ba + bb, &fa + &fb);
            // The sum of two f64 more than 512 bits apart is truncated; others are exact.
            prop_assert!(close(s, fs.clone()));
            let (p, fp) = (s * bc, fs * &fc);
            prop_assert!(close(p, fp.clone()));
            if d != 0.0 {
                let q = p.over(bd);
                prop_assert!(close(q, fp.clone() / &fd));
            }
            if fp > F::ZERO {
                prop_assert!(close(p.sqrt(), fp.sqrt()));
            }
            let (u, fu) = (bc * bc - ba * bb, &fc * &fc - &fa * &fb);
            if (a * b).abs() < 1e100 && (a * b).abs() > 1e-20 && c.abs() > 1e-20 && c.abs() < 1e50 {
                prop_assert!(close(u, fu));
            }
            prop_assert_eq!(ba.cmp(&bb), a.partial_cmp(&b).expect("finite"));
        }

        #[test]
        fn fractions_are_exact(whole in -1_000_000i64..1_000_000, part in 0u32..1 << 20, power in 0i32..400) {
            let part = f64::from(part) / f64::from(1 << 20);
            // A whole number far larger than f64 holds together with the fraction.
            let large = B::new(whole as f64) * B::new(2f64.powi(power)) + B::new(part);
            prop_assert_eq!(large.fraction().to_f64(), part);
            let negative = (-large).fraction().to_f64();
            prop_assert_eq!(negative, if part == 0.0 { 0.0 } else { 1.0 - part });
        }

        #[test]
        fn rounding_to_f64_is_nearest(a in any_finite(), b in any_finite()) {
            let p = (B::new(a) * B::new(b)).to_f64();
            prop_assert_eq!(p, a * b);
            prop_assert_eq!((B::new(a) + B::new(b)).to_f64(), a + b);
            // Quotients are truncated; only among the denormals can one lie half-way between two f64.
            if b != 0.0 && (a / b).is_normal() {
                prop_assert_eq!(B::new(a).over(B::new(b)).to_f64(), a / b);
            }
        }
    }
}
