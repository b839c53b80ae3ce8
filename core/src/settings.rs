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
    /// A path has at least its camera ray, and an end.
    #[error("max-depth must be 1 to {max}", max = Settings::MAX_DEPTH)]
    MaxDepth,
    /// Samples form a square grid of at most [`Sampling::MAX_GRID`] a side.
    #[error("samples must be a square number from 1 to {max}, not {0}", max = Sampling::MAX_GRID * Sampling::MAX_GRID)]
    Samples(u64),
    /// A scrambled sequence has at most [`Sampling::MAX_SAMPLES`] points.
    #[error("samples must be 1 to {max}, not {0}", max = Sampling::MAX_SAMPLES)]
    Scrambled(u64),
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

impl Transfer {
    /// Its name, as flags and reports have it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Srgb => "srgb",
            Self::Linear => "linear",
        }
    }
}

/// Which points of a pixel's square are sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// The centres of an n × n grid in every pixel.
    Uniform {
        /// Grid cells along a pixel's edge, 1 to [`Sampling::MAX_GRID`].
        grid: u32,
    },
    /// As many points of a scrambled low-discrepancy sequence in every pixel, another one in each.
    Scrambled {
        /// Points a pixel, 1 to the square of [`Sampling::MAX_GRID`].
        samples: u32,
    },
    /// As many points as each pixel needs, in passes of a [`Detail`] each.
    Adaptive,
}

/// How closely one pass over an adaptive picture looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Detail {
    /// One point in every square of so many pixels' edge, 2 to [`Detail::COARSEST`], which all its pixels show.
    Coarse {
        /// Pixels along an edge.
        step: u32,
    },
    /// Points go where they take off most, until a typical edge keeps this error.
    Within(Tolerance),
    /// The same of each square of the picture's 8 × 8 pixels by itself: nothing around it is sampled to know it by. For
    /// looks at single squares, which belong in no picture.
    Glance(Tolerance),
}

impl Detail {
    /// The greatest step.
    pub const COARSEST: u32 = 64;
}

/// One pass over an adaptive picture. Pixels depend on the scene, the settings, `detail` and their place
/// alone; `audit` decides which of them are sampled afresh to measure their errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Pass {
    /// How closely it looks.
    pub detail: Detail,
    /// How many of the pixels are audited.
    pub audit: AuditRate,
}

/// How likely pixels are audited, in 65,536ths: 0 for none; a pixel whose error is expected to be the
/// tolerance's is drawn with this probability, others in proportion to their expected squared error, with
/// a floor below ([`AuditRate::FLOOR`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AuditRate(pub u32);

impl AuditRate {
    /// The rate at which every pixel is audited.
    pub const ALL: Self = Self(u32::MAX);
    /// The least part of the rate with which a pixel is drawn that was not proven: that high, since what errs
    /// unexpectedly makes an estimate vary most.
    pub const FLOOR: f64 = 0.5;

    /// As a factor of probabilities; those above 1 are 1.
    #[must_use]
    pub fn factor(self) -> f64 {
        f64::from(self.0) / 65536.0
    }
}

/// The error that a typical edge pixel may keep (root mean square), in billionths of full scale. Others keep
/// more or less, such that the same effort takes off as much everywhere. A whole number, so that equal
/// tolerances are equal everywhere.
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
    /// To use it.
    #[default]
    Normal,
    /// To print it.
    Final,
    /// To hold others against it.
    Reference,
}

impl Quality {
    /// Every quality, the coarsest first.
    pub const ALL: [Self; 4] = [Self::Draft, Self::Normal, Self::Final, Self::Reference];

    /// The root mean squared error it stands for, as a fraction of full scale.
    #[must_use]
    pub fn rmse(self) -> f64 {
        let steps = match self {
            Self::Draft => 2.0,
            Self::Normal => 0.5,
            Self::Final => 0.25,
            Self::Reference => 0.05,
        };
        steps / 255.0
    }

    /// What users call it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Normal => "normal",
            Self::Final => "final",
            Self::Reference => "reference",
        }
    }
}

impl Sampling {
    /// The finest uniform grid, in cells along a pixel's edge.
    pub const MAX_GRID: u32 = 64;
    /// The most points of a scrambled sequence.
    pub const MAX_SAMPLES: u32 = Self::MAX_GRID * Self::MAX_GRID;

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

    /// Sampling by `samples` points of a scrambled sequence in every pixel.
    ///
    /// # Errors
    /// When they are none, or more than [`Sampling::MAX_SAMPLES`].
    pub fn scrambled(samples: u64) -> Result<Self, SettingsError> {
        match u32::try_from(samples) {
            Ok(samples @ 1..=Self::MAX_SAMPLES) => Ok(Self::Scrambled { samples }),
            _ => Err(SettingsError::Scrambled(samples)),
        }
    }
}

/// Everything a pixel depends on beside the scene and its own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The image plane.
    pub view: View,
    /// Rays in a path at most, camera ray included; 1 to [`Settings::MAX_DEPTH`].
    pub max_depth: u32,
    /// The points sampled.
    pub sampling: Sampling,
    /// The meaning of colour numbers.
    pub transfer: Transfer,
}

impl Settings {
    /// The most rays in a path. Between two mirrors that keep all light a path has no other end, and what is kept
    /// of it takes memory; no picture shows what comes from so deep.
    pub const MAX_DEPTH: u32 = 1 << 17;
}
