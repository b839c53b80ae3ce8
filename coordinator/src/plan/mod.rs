//! Which passes over the picture lead to the accuracy asked for, as a pure state machine.
//!
//! What a pass gives depends on the scene, the settings and the pass alone; the next one follows from the
//! estimates of those before. Towards an error ([`target`]) no clock is read, so that the picture is the same
//! wherever and by however many it was rendered; under a time limit ([`timed`]) it is.

mod cost;
mod look;
mod model;
mod target;
mod timed;

use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::settings::{Detail, Pass, Tolerance};

pub use cost::Forecast;
pub use model::{MODEL, Model};
use target::Target;
use timed::Timed;

/// How good a picture is to be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Goal {
    /// As the settings' sampling says.
    #[default]
    AsSet,
    /// Adaptive, with at most this root mean squared error over the whole view, as a fraction of full scale.
    Error(f64),
    /// Adaptive, the best there is when time is up, or this error if it is reached before.
    Time {
        /// From the beginning of the render.
        limit: Duration,
        /// The error that is enough.
        error: Option<f64>,
    },
}

/// A pass to be rendered.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Step {
    /// How closely it looks; `None` as the settings say.
    pub(crate) pass: Option<Pass>,
    /// Over what, the most rewarding first; the whole picture where empty.
    pub(crate) regions: Vec<Region>,
    /// Whether its pixels belong into the picture.
    pub(crate) kept: bool,
    /// How many times as dear a pixel is expected to be as in the pass before.
    pub(crate) dearer: f64,
}

/// What a pass gave.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outcome {
    /// The estimate over all of it.
    pub(crate) error: ErrorEstimate,
    /// Tiles and their estimates, where [`Plan::wants_tiles`].
    pub(crate) tiles: Vec<(Region, ErrorEstimate)>,
    /// How long it took.
    pub(crate) took: Duration,
    /// Since the render began.
    pub(crate) now: Duration,
}

/// See the [module](self).
#[derive(Debug)]
pub(crate) enum Plan {
    /// One pass by uniform sampling.
    AsSet,
    /// Passes towards an error.
    Target(Box<Target>),
    /// Passes until time is up.
    Timed(Timed),
}

impl Plan {
    /// A plan for the pixels of `region` in a picture of `view`.
    pub(crate) fn new(goal: Goal, view: Region, region: Region) -> Self {
        match goal {
            Goal::AsSet => Self::AsSet,
            Goal::Error(error) => Self::Target(Box::new(Target::new(error, view, region))),
            Goal::Time { limit, error } => Self::Timed(Timed::new(limit, error, region)),
        }
    }

    /// The first pass.
    pub(crate) fn first(&mut self) -> Step {
        match self {
            Self::AsSet => Step { pass: None, regions: Vec::new(), kept: true, dearer: 1.0 },
            Self::Target(target) => target.first(),
            Self::Timed(timed) => timed.first(),
        }
    }

    /// The pass after the one that gave `outcome`; `None` when the picture is done.
    pub(crate) fn next(&mut self, outcome: &Outcome) -> Option<Step> {
        match self {
            Self::AsSet => None,
            Self::Target(target) => target.next(outcome),
            Self::Timed(timed) => timed.next(outcome),
        }
    }

    /// Expected work in `region` in the pass at hand, in units of its own.
    pub(crate) fn work(&self, region: &Region) -> f64 {
        match self {
            Self::Target(target) => target.work(region),
            _ => region.area() as f64,
        }
    }

    /// How long the pass at hand is expected to take, where that can be told.
    pub(crate) fn expected(&self) -> Option<Duration> {
        match self {
            Self::Target(target) => target.expected(),
            _ => None,
        }
    }

    /// Whether tiles are to be remembered one by one.
    pub(crate) fn wants_tiles(&self) -> bool {
        match self {
            Self::AsSet => false,
            Self::Target(target) => target.is_looking(),
            Self::Timed(_) => true,
        }
    }

    /// When time is up, since the render began.
    pub(crate) fn limit(&self) -> Option<Duration> {
        match self {
            Self::Timed(timed) => Some(timed.limit()),
            _ => None,
        }
    }

    /// Whether the picture, of which `error` is known, is as good as was asked for; `None` where nothing was.
    pub(crate) fn is_met(&self, error: &ErrorEstimate) -> Option<bool> {
        match self {
            Self::AsSet => None,
            Self::Target(target) => Some(target.is_met(error)),
            Self::Timed(timed) => timed.error().map(|e| reaches(error, e)),
        }
    }
}

/// Whether an error of `target` is kept to, as far as can be told: the upper end of the interval does.
fn reaches(error: &ErrorEstimate, target: f64) -> bool {
    error.interval().1 <= target
}

/// What a pass within `tolerance` over the picture is, audited so often.
fn within(tolerance: Tolerance, audit: tessera_core::settings::AuditRate) -> Option<Pass> {
    Some(Pass { detail: Detail::Within(tolerance), audit })
}

#[cfg(test)]
mod tests;
