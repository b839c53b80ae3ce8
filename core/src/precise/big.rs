//! A binary floating-point number of a fixed, large precision and a practically unbounded exponent.
//!
//! Every operation truncates its exact result to 64·N bits, so its relative error is
//! below 2^(8−64N). There is no overflow, no underflow, no NaN and no infinity: what
//! real arithmetic leaves undefined (division by zero, the root of a negative number)
//! gives zero, and callers ask first.

use std::cmp::Ordering;
use std::ops::{Add, Mul, Neg, Sub};

/// ± mantissa · 2^(exponent − 64·N), the mantissa's top bit set; zero has an all-zero mantissa.
/// Limbs are stored least significant first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Big<const N: usize> {
    negative: bool,
    exponent: i64,
    limbs: [u64; N],
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

    /// |self| + |other|, with the sign given.
    fn add_magnitudes(big: &Self, small: &Self, negative: bool) -> Self {
        let gap = (big.exponent - small.exponent) as u64;
        if small.is_zero() || gap >= 64 * N as u64 {
            return Self { negative, ..*big };
        }
        let shifted = shift_right(&small.limbs, gap);
        let mut limbs = [0; N];
        let mut carry = false;
        for i in 0..N {
            let (s, c1) = big.limbs[i].overflowing_add(shifted[i]);
            let (s, c2) = s.overflowing_add(u64::from(carry));
            limbs[i] = s;
            carry = c1 || c2;
        }
        let mut exponent = big.exponent;
        if carry {
            limbs = shift_right(&limbs, 1);
            limbs[N - 1] |= 1 << 63;
            exponent += 1;
        }
        Self { negative, exponent, limbs }
    }

    /// |big| − |small| where |big| > |small|, with the sign given.
    fn sub_magnitudes(big: &Self, small: &Self, negative: bool) -> Self {
        let gap = (big.exponent - small.exponent) as u64;
        if small.is_zero() || gap > 64 * N as u64 {
            return Self { negative, ..*big };
        }
        // One guard limb below keeps the error of a subtraction under one unit in the last place.
        let mut guard = 0u64;
        let shifted = {
            let limb = (gap / 64) as usize;
            let bit = (gap % 64) as u32;
            if limb < N {
                guard = if bit == 0 { 0 } else { small.limbs[limb] << (64 - bit) };
            }
            if bit == 0 && limb > 0 && limb <= N {
                guard = small.limbs[limb - 1];
            } else if limb > 0 && limb <= N && bit != 0 {
                guard |= small.limbs[limb - 1] >> bit;
            }
            shift_right(&small.limbs, gap)
        };
        let (mut low, mut borrow) = 0u64.overflowing_sub(guard);
        let mut limbs = [0; N];
        for i in 0..N {
            let (s, b1) = big.limbs[i].overflowing_sub(shifted[i]);
            let (s, b2) = s.overflowing_sub(u64::from(borrow));
            limbs[i] = s;
            borrow = b1 || b2;
        }
        // Normalise over the N limbs and the guard.
        let Some(top) = (0..N).rev().find(|&i| limbs[i] != 0) else {
            if low == 0 {
                return Self::ZERO;
            }
            let z = low.leading_zeros();
            let mut out = [0; N];
            out[N - 1] = low << z;
            return Self { negative, exponent: big.exponent - 64 * N as i64 - i64::from(z), limbs: out };
        };
        let skip = N - 1 - top;
        let z = limbs[top].leading_zeros();
        if skip > 0 {
            for i in (0..N).rev() {
                limbs[i] = if i >= skip {
                    limbs[i - skip]
                } else if i + 1 == skip {
                    low
                } else {
                    0
                };
            }
            low = 0;
        }
        if z > 0 {
            for i in (1..N).rev() {
                limbs[i] = (limbs[i] << z) | (limbs[i - 1] >> (64 - z));
            }
            limbs[0] = (limbs[0] << z) | (low >> (64 - z));
        }
        Self { negative, exponent: big.exponent - 64 * skip as i64 - i64::from(z), limbs }
    }

    /// self / divisor; zero where the divisor is zero.
    #[must_use]
    pub fn over(self, divisor: Self) -> Self {
        self * divisor.reciprocal()
    }

    /// 1 / self by Newton's iteration from an f64 start; zero for zero.
    #[must_use]
    pub fn reciprocal(self) -> Self {
        if self.is_zero() {
            return Self::ZERO;
        }
        let unit = Self { negative: false, exponent: 0, ..self }; // in [1/2, 1)
        let one = Self::new(1.0);
        let mut x = Self::new(1.0 / unit.to_f64());
        for step in 0..Self::newton_steps() {
            // Limbs that are zero cost a product nothing, where they are its first factor's.
            let known = x.cut(step);
            x = known + known * (one - known * unit);
        }
        Self { negative: self.negative, exponent: x.exponent - self.exponent, ..x }
    }

    /// The square root of `self`; zero where it is negative.
    #[must_use]
    pub fn sqrt(self) -> Self {
        if self.is_zero() || self.negative {
            return Self::ZERO;
        }
        let half_power = self.exponent.div_euclid(2);
        let unit = self.scale(-2 * half_power); // in [1/2, 2)
        let one = Self::new(1.0);
        let mut x = Self::new(1.0 / unit.to_f64().sqrt());
        for step in 0..Self::newton_steps() {
            let known = x.cut(step);
            x = known + (known * (one - known * (known * unit))).scale(-1);
        }
        (unit * x).scale(half_power)
    }

    /// Only the limbs that are right before step `step` of an iteration from 50 bits, and one more.
    fn cut(mut self, step: u32) -> Self {
        let right = (50usize << step).div_ceil(64) + 1;
        for limb in self.limbs.iter_mut().rev().skip(right) {
            *limb = 0;
        }
        self
    }

    fn newton_steps() -> u32 {
        // 50 good bits at the start, twice as many after each step, one step for the last units.
        (64 * N as u32).div_ceil(50).next_power_of_two().trailing_zeros() + 1
    }
}

/// `limbs` shifted down by `by` bits.
fn shift_right<const N: usize>(limbs: &[u64; N], by: u64) -> [u64; N] {
    let (limb, bit) = ((by / 64) as usize, (by % 64) as u32);
    let mut out = [0; N];
    for i in 0..N.saturating_sub(limb) {
        let low = limbs[i + limb] >> bit;
        let high = if bit > 0 && i + limb + 1 < N { limbs[i + limb + 1] << (64 - bit) } else { 0 };
        out[i] = low | high;
    }
    out
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
    fn add(self, other: Self) -> Self {
        let order = self.cmp_magnitude(&other);
        let (big, small) = if order == Ordering::Less { (&other, &self) } else { (&self, &other) };
        if big.is_zero() {
            return Self::ZERO;
        }
        if self.negative == other.negative || small.is_zero() {
            Self::add_magnitudes(big, small, big.negative)
        } else if order == Ordering::Equal {
            Self::ZERO
        } else {
            Self::sub_magnitudes(big, small, big.negative)
        }
    }
}

impl<const N: usize> Sub for Big<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl<const N: usize> Mul for Big<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        if self.is_zero() || other.is_zero() {
            return Self::ZERO;
        }
        // Columns below N − 1 cannot reach the kept limbs but for a carry of under 2N units of the guard.
        let mut columns = [[0u64; 2]; N];
        let product = &mut columns.as_flattened_mut()[..2 * N];
        for i in 0..N {
            if self.limbs[i] == 0 {
                continue;
            }
            let mut carry = 0u64;
            for j in (N - 1).saturating_sub(i)..N {
                let t = u128::from(self.limbs[i]) * u128::from(other.limbs[j])
                    + u128::from(product[i + j])
                    + u128::from(carry);
                product[i + j] = t as u64;
                carry = (t >> 64) as u64;
            }
            product[i + N] = carry;
        }
        let mut limbs = [0; N];
        limbs.copy_from_slice(&product[N..]);
        let mut exponent = self.exponent + other.exponent;
        if limbs[N - 1] >> 63 == 0 {
            for i in (1..N).rev() {
                limbs[i] = (limbs[i] << 1) | (limbs[i - 1] >> 63);
            }
            limbs[0] = (limbs[0] << 1) | (product[N - 1] >> 63);
            exponent -= 1;
        }
        Self { negative: self.negative != other.negative, exponent, limbs }
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
