//! What a picture depends on beside its scene.

/// The image plane: pixels, distance and height. Pixels are square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    width: u32,
    height: u32,
    zoom: f64,
    plane_height: f64,
}

/// Why a [`View`] or [`Settings`] cannot be had.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// A picture needs at least one pixel each way and at most [`View::MAX_EDGE`].
    #[error("a picture is 1 to {max} pixels wide and high, not {0}x{1}", max = View::MAX_EDGE)]
    Size(u64, u64),
    /// Zoom is a distance before the camera.
    #[error("zoom must be a finite number above 0, not {0}")]
    Zoom(f64),
    /// The plane has an extent.
    #[error("the image plane's height must be a finite number above 0, not {0}")]
    PlaneHeight(f64),
    /// A path has at least its camera ray.
    #[error("max-depth must be at least 1")]
    MaxDepth,
    /// Samples form a square grid of at most [`Sampling::MAX_GRID`] a side.
    #[error("samples must be a square number from 1 to {max}, not {0}", max = Sampling::MAX_GRID * Sampling::MAX_GRID)]
    Samples(u64),
}

impl View {
    /// The longest edge of a picture, in pixels.
    pub const MAX_EDGE: u32 = 1 << 16;

    /// An image plane of `width` × `height` pixels at distance `zoom`, `plane_height` high.
    ///
    /// # Errors
    /// When a size is out of range, or a length is not a finite number above 0.
    pub fn new(width: u32, height: u32, zoom: f64, plane_height: f64) -> Result<Self, SettingsError> {
        let edge = 1..=Self::MAX_EDGE;
        if !edge.contains(&width) || !edge.contains(&height) {
            return Err(SettingsError::Size(width.into(), height.into()));
        }
        if !(zoom > 0.0 && zoom.is_finite()) {
            return Err(SettingsError::Zoom(zoom));
        }
        if !(plane_height > 0.0 && plane_height.is_finite()) {
            return Err(SettingsError::PlaneHeight(plane_height));
        }
        Ok(Self { width, height, zoom, plane_height })
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Distance of the image plane from the camera.
    #[must_use]
    pub fn zoom(&self) -> f64 {
        self.zoom
    }

    /// Height of the image plane.
    #[must_use]
    pub fn plane_height(&self) -> f64 {
        self.plane_height
    }
}

/// How colour numbers are meant, in scenes, pictures and integer outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Transfer {
    /// sRGB-encoded: decoded before arithmetic, encoded after it.
    #[default]
    Srgb,
    /// Linear throughout.
    Linear,
}

/// Which points of a pixel's square are sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// The centres of an n × n grid in every pixel.
    Uniform {
        /// Grid cells along a pixel's edge, 1 to [`Sampling::MAX_GRID`].
        grid: u32,
    },
    /// Pixels' corners, and more wherever the picture's edges and variation ask for it.
    Adaptive {
        /// When a part of a pixel is known well enough.
        tolerance: Tolerance,
        /// Whether every pixel is to keep to it, whatever it costs; else pixels whose rays are
        /// dear may miss it, so that the picture as a whole is as good as so many rays allow.
        every_pixel: bool,
    },
}

/// The standard deviation that a pixel's error may keep, in billionths of full scale. A whole
/// number, so that equal tolerances are equal everywhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tolerance {
    billionths: u32,
}

impl Tolerance {
    /// The tightest tolerance.
    pub const MIN: Self = Self { billionths: 1_000 };
    /// The loosest.
    pub const MAX: Self = Self { billionths: 4_000_000_000 };

    /// The tolerance nearest to `fraction` of full scale, within [`Tolerance::MIN`] and [`Tolerance::MAX`].
    #[must_use]
    pub fn new(fraction: f64) -> Self {
        // `as` saturates, and takes what is not a number for 0.
        Self::from_billionths((fraction * 1e9).round() as u32)
    }

    /// The tolerance of so many billionths, within [`Tolerance::MIN`] and [`Tolerance::MAX`].
    #[must_use]
    pub fn from_billionths(billionths: u32) -> Self {
        Self { billionths: billionths.clamp(Self::MIN.billionths, Self::MAX.billionths) }
    }

    /// In billionths of full scale.
    #[must_use]
    pub fn billionths(self) -> u32 {
        self.billionths
    }

    /// As a fraction of full scale.
    #[must_use]
    pub fn fraction(self) -> f64 {
        f64::from(self.billionths) * 1e-9
    }
}

/// Named points on the curve of time against accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Quality {
    /// To see what is where.
    Draft,
    /// To judge it.
    Preview,
    /// To use it: nearly all pixels within 1/255.
    #[default]
    Final,
    /// To hold others against it.
    Reference,
}

impl Quality {
    /// Every quality, the coarsest first.
    pub const ALL: [Self; 4] = [Self::Draft, Self::Preview, Self::Final, Self::Reference];

    /// The sampling it stands for.
    #[must_use]
    pub fn sampling(self) -> Sampling {
        let every_pixel = matches!(self, Self::Final | Self::Reference);
        Sampling::Adaptive { tolerance: self.tolerance(), every_pixel }
    }

    /// The tolerance it stands for.
    #[must_use]
    pub fn tolerance(self) -> Tolerance {
        let steps = match self {
            Self::Draft => 8.0,
            Self::Preview => 1.0,
            Self::Final => 0.22,
            Self::Reference => 0.1,
        };
        Tolerance::new(steps / 255.0)
    }

    /// What users call it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Preview => "preview",
            Self::Final => "final",
            Self::Reference => "reference",
        }
    }
}

impl Sampling {
    /// The finest uniform grid, in cells along a pixel's edge.
    pub const MAX_GRID: u32 = 64;

    /// For a target of the picture as a whole, whose passes bring tolerances of their own.
    pub const TOWARDS_A_TARGET: Self = Self::Adaptive { tolerance: Tolerance::MAX, every_pixel: false };

    /// Uniform sampling by `samples` = n² points a pixel.
    ///
    /// # Errors
    /// When `samples` is not a square number in range.
    pub fn uniform(samples: u64) -> Result<Self, SettingsError> {
        (1..=Self::MAX_GRID)
            .find(|&n| u64::from(n) * u64::from(n) == samples)
            .map(|grid| Self::Uniform { grid })
            .ok_or(SettingsError::Samples(samples))
    }
}

/// Everything a pixel depends on beside the scene and its own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The image plane.
    pub view: View,
    /// Rays in a path at most, camera ray included; at least 1.
    pub max_depth: u32,
    /// The points sampled.
    pub sampling: Sampling,
    /// The meaning of colour numbers.
    pub transfer: Transfer,
}
