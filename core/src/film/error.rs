//! How far pixels are thought to be from what the image model says.

/// Estimated errors of a set of pixels, kept as whole numbers so that sums are the same in any order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ErrorEstimate {
    /// Pixels that have an estimate.
    pub pixels: u64,
    /// Sum of their expected squared errors, the mean of the components' each, in units of
    /// 2^−[`ErrorEstimate::SHIFT`] of full scale squared.
    pub squares: u64,
    /// The largest standard deviation of a pixel, in billionths of full scale.
    pub worst: u32,
}

impl ErrorEstimate {
    /// See [`ErrorEstimate::squares`].
    pub const SHIFT: u32 = 30;
    /// The largest expected squared error that a pixel can have here.
    const MOST: f64 = 1.0;
    /// How many standard deviations a pixel's error bound is.
    pub const DEVIATIONS: f64 = 3.0;

    /// Adds a pixel whose error's variance is `variance`.
    pub fn add_pixel(&mut self, variance: f64) {
        let variance = variance.min(Self::MOST);
        self.pixels += 1;
        // Rounded up: a doubt is never lost.
        self.squares = self.squares.saturating_add((variance * f64::from(1u32 << Self::SHIFT)).ceil() as u64);
        self.worst = self.worst.max((variance.sqrt() * 1e9).ceil() as u32);
    }

    /// Expected root mean squared error over the pixels, as a fraction of full scale.
    #[must_use]
    pub fn rmse(&self) -> f64 {
        if self.pixels == 0 {
            return 0.0;
        }
        (self.squares as f64 / self.pixels as f64 / f64::from(1u32 << Self::SHIFT)).sqrt()
    }

    /// Bound on the worst pixel's error, as a fraction of full scale.
    #[must_use]
    pub fn worst_pixel(&self) -> f64 {
        Self::DEVIATIONS * f64::from(self.worst) * 1e-9
    }
}

impl std::ops::AddAssign for ErrorEstimate {
    fn add_assign(&mut self, o: Self) {
        self.pixels += o.pixels;
        self.squares = self.squares.saturating_add(o.squares);
        self.worst = self.worst.max(o.worst);
    }
}
