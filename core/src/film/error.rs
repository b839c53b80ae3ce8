//! How far a picture is from what the image model says: measured by an audit, and expected.

/// Numbers from here on are whole.
const WHOLE: f64 = 4_503_599_627_370_496.0; // 2⁵²

/// A sum of real numbers in whole units of 2⁻⁶⁴, so that it is the same in any order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sum(pub i128);

impl Sum {
    const UNIT: f64 = 18_446_744_073_709_551_616.0; // 2⁶⁴

    /// The nearest sum to `x`; what is not a number, or too large, is the largest there is.
    #[must_use]
    pub fn new(x: f64) -> Self {
        let units = x * Self::UNIT;
        if units.abs() < WHOLE {
            // What `round` gives, without a call to a library.
            let whole = units as i64;
            let rest = units - whole as f64;
            return Self(i128::from(whole + i64::from(rest >= 0.5) - i64::from(rest <= -0.5)));
        }
        // `as` saturates.
        Self(if units.is_nan() { i128::MAX } else { units as i128 })
    }

    /// Its value.
    #[must_use]
    pub fn value(self) -> f64 {
        self.0 as f64 / Self::UNIT
    }
}

impl std::ops::AddAssign for Sum {
    fn add_assign(&mut self, o: Self) {
        self.0 = self.0.saturating_add(o.0);
    }
}

/// The error of a set of pixels. Squares are the mean of the components', of linear light, full scale being 1.
///
/// Some pixels, drawn at random with known probabilities, are sampled afresh by two independent sets of
/// points. With Y₁ and Y₂ what these give, and X the pixel's value, (X − Y₁)(X − Y₂) has the pixel's squared
/// error for its mean, whatever the sampler believed; divided by the probability of being drawn (Horvitz and
/// Thompson, *A generalization of sampling without replacement from a finite universe*, 1952) it adds up to
/// an unbiased estimate of the whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ErrorEstimate {
    /// Pixels rendered.
    pub pixels: u64,
    /// What the sampler expects: sum of the pixels' mean squared errors.
    pub expected: Sum,
    /// Pixels audited.
    pub audited: u64,
    /// The audit's estimate of the sum of squared errors; below 0 by chance where there is next to none.
    pub squares: Sum,
    /// The variance of [`Self::squares`].
    pub variance: Sum,
}

/// Standard deviations to the ends of a 95 % interval.
const DEVIATIONS: f64 = 1.96;

impl ErrorEstimate {
    /// Adds a pixel whose squared error is expected to be so much.
    pub fn add(&mut self, expected: f64) {
        self.pixels += 1;
        // Most pixels are proven.
        if expected != 0.0 {
            self.expected += Sum::new(expected);
        }
    }

    /// Adds an audited pixel that was drawn with `probability`: an unbiased estimate of its squared error, and
    /// of the variance of that.
    pub fn audit(&mut self, square: f64, noise: f64, probability: f64) {
        self.audited += 1;
        let share = square / probability;
        self.squares += Sum::new(share);
        self.variance += Sum::new(share * share * (1.0 - probability) + noise / (probability * probability));
    }

    fn root(&self, squares: f64) -> f64 {
        if self.pixels == 0 { 0.0 } else { (squares.max(0.0) / self.pixels as f64).sqrt() }
    }

    /// Root mean squared error over the pixels: the audit's where there was one, else what is expected.
    ///
    /// At least a quarter of the [interval](Self::interval)'s upper end: where that is so far above what was found,
    /// few pixels have most of the error, and those drawn are likely to have missed some.
    #[must_use]
    pub fn rmse(&self) -> f64 {
        if self.audited == 0 {
            return self.expected_rmse();
        }
        self.root(self.squares.value()).max(0.25 * self.interval().1)
    }

    /// Root mean squared error that the sampler expects.
    #[must_use]
    pub fn expected_rmse(&self) -> f64 {
        self.root(self.expected.value())
    }

    /// The 95 % interval of [`Self::rmse`]; without an audit nothing is known.
    #[must_use]
    pub fn interval(&self) -> (f64, f64) {
        if self.audited == 0 {
            return (0.0, f64::INFINITY);
        }
        let (squares, deviation) = (self.squares.value().max(0.0), self.variance.value().max(0.0).sqrt());
        // Errors are skewed: few pixels have most of them. An interval of the logarithm keeps that in mind.
        let ratio = deviation / squares.max(f64::MIN_POSITIVE);
        let spread = (DEVIATIONS * (1.0 + ratio * ratio).ln().sqrt()).exp();
        let upper = if squares > 0.0 { squares * spread } else { DEVIATIONS * deviation };
        (self.root(squares / spread), self.root(upper.max(squares + DEVIATIONS * deviation)))
    }
}

impl std::ops::AddAssign for ErrorEstimate {
    fn add_assign(&mut self, o: Self) {
        self.pixels += o.pixels;
        self.expected += o.expected;
        self.audited += o.audited;
        self.squares += o.squares;
        self.variance += o.variance;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn sums_are_the_nearest(bits in any::<u64>(), halves in -40i64..40, small in -1e-3..1e-3) {
            for x in [f64::from_bits(bits), halves as f64 * (0.5 / Sum::UNIT), small] {
                let units = (x * Sum::UNIT).round();
                let nearest = if units.is_nan() { i128::MAX } else { units as i128 };
                prop_assert_eq!(Sum::new(x).0, nearest, "{}", x);
            }
        }
    }
}
