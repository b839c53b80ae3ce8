//! How far pixels are thought to be from what the image model says, by cause.

/// What is thought of one pixel's error, as fractions of full scale.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelError {
    /// Variance of the error that comes from where samples are: the components' mean.
    pub samples: f64,
    /// Bound on what paths lost because they were followed no farther for want of weight.
    pub weight: f64,
    /// Bound on what paths lost because they were as deep as the settings allow. This is no part
    /// of the estimate: the model is then one of so many rays.
    pub depth: f64,
}

impl PixelError {
    /// Variance of the pixel's error: what is lost for want of weight is anything up to its bound.
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.samples + self.weight * self.weight / 3.0
    }
}

/// Estimated errors of a set of pixels, kept as whole numbers so that sums are the same in any
/// order. Squares are in units of 2^−[`ErrorEstimate::SHIFT`] of full scale squared, rounded up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ErrorEstimate {
    /// Pixels that have an estimate.
    pub pixels: u64,
    /// Sum of their expected squared errors, the mean of the components' each.
    pub squares: u64,
    /// The part of that which is due to [`PixelError::weight`].
    pub weight_squares: u64,
    /// Sum of the squares of [`PixelError::depth`].
    pub depth_squares: u64,
    /// The largest standard deviation of a pixel, in billionths of full scale.
    pub worst: u32,
}

impl ErrorEstimate {
    /// See [`ErrorEstimate`].
    pub const SHIFT: u32 = 30;
    /// The largest expected squared error that a pixel can have here.
    const MOST: f64 = 1.0;
    /// How many standard deviations a pixel's error bound is. Misplaced edges are not noise: errors
    /// beyond three are more frequent than a normal distribution's.
    pub const DEVIATIONS: f64 = 4.0;

    /// Adds a pixel.
    pub fn add(&mut self, error: &PixelError) {
        // Rounded up: a doubt is never lost. What is not a number counts as the most.
        let units = |square: f64| {
            let square = if square < Self::MOST { square } else { Self::MOST };
            (square * f64::from(1u32 << Self::SHIFT)).ceil() as u64
        };
        let variance = error.variance();
        self.pixels += 1;
        self.squares = self.squares.saturating_add(units(variance));
        self.weight_squares = self.weight_squares.saturating_add(units(error.weight * error.weight / 3.0));
        self.depth_squares = self.depth_squares.saturating_add(units(error.depth * error.depth));
        self.worst = self.worst.max((variance.min(Self::MOST).sqrt() * 1e9).ceil() as u32);
    }

    fn root(&self, squares: u64) -> f64 {
        if self.pixels == 0 {
            return 0.0;
        }
        (squares as f64 / self.pixels as f64 / f64::from(1u32 << Self::SHIFT)).sqrt()
    }

    /// Expected root mean squared error over the pixels, as a fraction of full scale.
    #[must_use]
    pub fn rmse(&self) -> f64 {
        self.root(self.squares)
    }

    /// The part of [`Self::rmse`] that is due to where samples are.
    #[must_use]
    pub fn samples_rmse(&self) -> f64 {
        self.root(self.squares.saturating_sub(self.weight_squares))
    }

    /// The part of [`Self::rmse`] that is due to paths too faint to be followed.
    #[must_use]
    pub fn weight_rmse(&self) -> f64 {
        self.root(self.weight_squares)
    }

    /// Bound on the root mean square of what paths lost by being cut at the greatest depth.
    #[must_use]
    pub fn depth_bound(&self) -> f64 {
        self.root(self.depth_squares)
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
        self.weight_squares = self.weight_squares.saturating_add(o.weight_squares);
        self.depth_squares = self.depth_squares.saturating_add(o.depth_squares);
        self.worst = self.worst.max(o.worst);
    }
}
