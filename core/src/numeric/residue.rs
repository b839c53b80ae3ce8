//! Binary fractions modulo a prime: equal ones have equal residues.

/// 2^61 − 1, a prime.
const PRIME: u64 = (1 << 61) - 1;

/// A number modulo [`PRIME`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Residue(pub(crate) u64);

impl Residue {
    fn new(x: u128) -> Self {
        let folded = (x & u128::from(PRIME)) + (x >> 61);
        let folded = (folded & u128::from(PRIME)) as u64 + (folded >> 61) as u64;
        Self(if folded >= PRIME { folded - PRIME } else { folded })
    }

    /// Of a binary fraction: 2^61 is 1.
    pub(crate) fn of(x: f64) -> Self {
        let bits = x.to_bits();
        let (biased, fraction) = (((bits >> 52) & 0x7ff) as i64, bits & ((1 << 52) - 1));
        let (mantissa, power) = if biased == 0 { (fraction, -1074) } else { (fraction | 1 << 52, biased - 1075) };
        let magnitude = Self::new(u128::from(mantissa) << power.rem_euclid(61));
        if x < 0.0 { Self(0) - magnitude } else { magnitude }
    }

    /// 1 / self, by Fermat's little theorem; 0 of 0.
    pub(crate) fn inverse(self) -> Self {
        // The exponent, 2^61 − 3, has all bits but the second.
        let (mut power, mut result) = (self, self);
        for k in 1..61 {
            power = power * power;
            if k != 1 {
                result = result * power;
            }
        }
        result
    }
}

impl std::ops::Add for Residue {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self::new(u128::from(self.0) + u128::from(o.0))
    }
}

impl std::ops::Sub for Residue {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self::new(u128::from(self.0) + u128::from(PRIME - o.0))
    }
}

impl std::ops::Mul for Residue {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self::new(u128::from(self.0) * u128::from(o.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverses_are_inverses() {
        for x in [1.0, 2.0, 0.5, -3.0, 1e300, 5e-324, 0.1] {
            assert!(Residue::of(x) * Residue::of(x).inverse() == Residue(1), "{x}");
        }
        assert!(Residue::of(0.75) + Residue::of(0.25) == Residue::of(1.0));
        assert!(Residue::of(1e10) - Residue::of(1e10) == Residue(0));
    }
}
