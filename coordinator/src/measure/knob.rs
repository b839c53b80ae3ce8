//! The settings that trade speed for accuracy.

use tessera_core::settings::{Quality, Sampling, Settings};

use crate::plan::Goal;

/// Ways to trade speed for accuracy, each a line of the plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Method {
    /// Adaptive sampling towards an error.
    MaxError,
    /// Adaptive sampling by name.
    Quality,
    /// As many points in every pixel, in a grid.
    Samples,
    /// As many scrambled points in every pixel.
    Scrambled,
    /// Shorter paths, at one quality.
    MaxDepth,
    /// POV-Ray's anti-aliasing.
    PovRay,
}

impl Method {
    /// Every method, in the order of tables.
    pub const ALL: [Self; 6] =
        [Self::MaxError, Self::Quality, Self::Samples, Self::Scrambled, Self::MaxDepth, Self::PovRay];

    /// What tables and files call it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::MaxError => "max-error",
            Self::Quality => "quality",
            Self::Samples => "samples",
            Self::Scrambled => "scrambled",
            Self::MaxDepth => "max-depth",
            Self::PovRay => "pov-ray",
        }
    }
}

/// One setting of this program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Knob {
    /// A root mean squared error to aim at, in 8-bit steps.
    MaxError(f64),
    /// A named quality.
    Quality(Quality),
    /// A grid of so many points a side in every pixel.
    Samples(u32),
    /// The square of so many scrambled points in every pixel.
    Scrambled(u32),
    /// At most so many rays a path, at this quality.
    MaxDepth(u32, Quality),
}

impl Knob {
    /// Its method.
    #[must_use]
    pub fn method(&self) -> Method {
        match self {
            Self::MaxError(_) => Method::MaxError,
            Self::Quality(_) => Method::Quality,
            Self::Samples(_) => Method::Samples,
            Self::Scrambled(_) => Method::Scrambled,
            Self::MaxDepth(..) => Method::MaxDepth,
        }
    }

    /// Its value, as flags spell it.
    #[must_use]
    pub fn value(&self) -> String {
        match self {
            Self::MaxError(steps) => format!("{steps}"),
            Self::Quality(quality) => quality.name().into(),
            Self::Samples(grid) | Self::Scrambled(grid) => (grid * grid).to_string(),
            Self::MaxDepth(depth, _) => depth.to_string(),
        }
    }

    /// The flags that `render` takes for it; of [`Self::MaxDepth`], for its depth alone.
    #[must_use]
    pub fn flags(&self) -> Vec<String> {
        match self {
            Self::Scrambled(_) => ["--samples", &self.value(), "--pattern", "scrambled"].map(str::to_owned).into(),
            _ => vec![format!("--{}", self.method().name()), self.value()],
        }
    }

    /// What a render under `base` becomes by it.
    #[must_use]
    pub fn apply(&self, base: &Settings) -> (Settings, Goal) {
        match *self {
            Self::MaxError(steps) => (Settings { sampling: Sampling::Adaptive, ..*base }, Goal::Error(steps / 255.0)),
            Self::Quality(quality) => (Settings { sampling: Sampling::Adaptive, ..*base }, Goal::Error(quality.rmse())),
            Self::Samples(grid) => (Settings { sampling: Sampling::Uniform { grid }, ..*base }, Goal::AsSet),
            Self::Scrambled(grid) => {
                (Settings { sampling: Sampling::Scrambled { samples: grid * grid }, ..*base }, Goal::AsSet)
            }
            Self::MaxDepth(max_depth, quality) => {
                (Settings { max_depth, sampling: Sampling::Adaptive, ..*base }, Goal::Error(quality.rmse()))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use tessera_core::settings::{Transfer, View};

    use super::*;

    #[test]
    fn flags_say_what_is_applied() {
        let view = View::new(4, 3, 1.0, 1.0).expect("valid");
        let base =
            Settings { view, max_depth: 16, sampling: Sampling::Uniform { grid: 1 }, transfer: Transfer::Linear };
        let told = |knob: Knob| knob.flags().join(" ");
        assert_eq!(told(Knob::Samples(3)), "--samples 9");
        assert_eq!(Knob::Samples(3).apply(&base).0.sampling, Sampling::Uniform { grid: 3 });
        assert_eq!(told(Knob::Scrambled(3)), "--samples 9 --pattern scrambled");
        assert_eq!(Knob::Scrambled(3).apply(&base).0.sampling, Sampling::Scrambled { samples: 9 });
        assert_eq!(told(Knob::MaxError(0.5)), "--max-error 0.5");
        let (settings, goal) = Knob::MaxError(0.5).apply(&base);
        assert_eq!((settings.sampling, goal), (Sampling::Adaptive, Goal::Error(0.5 / 255.0)));
        assert_eq!(told(Knob::Quality(Quality::Draft)), "--quality draft");
        let shallow = Knob::MaxDepth(2, Quality::Draft);
        assert_eq!(told(shallow), "--max-depth 2");
        let (settings, goal) = shallow.apply(&base);
        assert_eq!((settings.max_depth, goal), (2, Knob::Quality(Quality::Draft).apply(&base).1));
    }
}
