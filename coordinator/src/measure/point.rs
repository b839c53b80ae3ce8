//! What was measured.

use std::time::Duration;

use tessera_core::film::Metrics;
use tessera_core::settings::{Quality, Settings};
use tessera_core::trace::RayCounts;

use super::knob::Method;
use super::reference::Reference;

/// An error that a render predicted of itself, in fractions of full scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Predicted {
    /// Root mean squared, over the picture.
    pub rmse: f64,
    /// The upper end of its 95 % interval.
    pub upper: f64,
}

/// Rays of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rays {
    /// From the camera.
    pub camera: u64,
    /// From mirrors.
    pub mirror: u64,
    /// Towards lights, where they are told.
    pub shadow: Option<u64>,
}

impl Rays {
    /// All of them, where all are told.
    #[must_use]
    pub fn total(&self) -> Option<u64> {
        Some(self.camera + self.mirror + self.shadow?)
    }
}

impl From<RayCounts> for Rays {
    fn from(counts: RayCounts) -> Self {
        Self { camera: counts.camera, mirror: counts.mirror, shadow: Some(counts.shadow) }
    }
}

/// One setting, what it took and how close it came.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The way of trading.
    pub method: Method,
    /// Its value, as flags spell it.
    pub value: String,
    /// The program's own flags for it.
    pub flags: Vec<String>,
    /// From structures built to the last pixel: the median of all runs.
    pub trace: Duration,
    /// The whole job, reading and writing included: the median of all runs.
    pub whole: Duration,
    /// The shortest and the longest of `trace`.
    pub spread: (Duration, Duration),
    /// How often it was rendered.
    pub runs: u32,
    /// Its rays, where they are told.
    pub rays: Option<Rays>,
    /// How far it is from the reference.
    pub metrics: Metrics,
    /// How far it thought it would be.
    pub predicted: Option<Predicted>,
    /// Whether its distance from the reference is no more than three times the reference's own
    /// error: the reference cannot tell how close it really is.
    pub beyond_reference: bool,
    /// Whether nothing measured is both quicker and closer.
    pub front: bool,
}

/// A setting that was not rendered, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Skipped {
    /// Method and value.
    pub what: String,
    /// Why.
    pub why: String,
}

/// The cheapest setting measured that is close enough.
#[derive(Clone, Debug, PartialEq)]
pub struct Recommendation {
    /// Its place among the points.
    pub point: usize,
}

/// Everything that was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// The scene's name.
    pub scene: String,
    /// What all renders had in common.
    pub settings: Settings,
    /// Workers and threads.
    pub workers: usize,
    /// Threads of all workers.
    pub threads: usize,
    /// Reading and building, once.
    pub read: Duration,
    /// See `read`.
    pub build: Duration,
    /// The error asked for, in 8-bit steps.
    pub target: f64,
    /// What all were held against; `None` where it was not finished: there are no points then.
    pub reference: Option<Reference>,
    /// Whether all were compared as codes can hold them: clamped to [0, 1].
    pub clamped: bool,
    /// Points by method, the coarsest setting of each first.
    pub points: Vec<Point>,
    /// What was left out.
    pub skipped: Vec<Skipped>,
    /// The setting to take.
    pub recommendation: Option<Recommendation>,
    /// Whether a signal ended it early.
    pub interrupted: bool,
}

impl Point {
    /// The finest quality whose error it keeps to; `None` where it does not keep to the coarsest's.
    #[must_use]
    pub fn quality(&self) -> Option<Quality> {
        Quality::ALL.into_iter().rev().find(|q| self.metrics.rmse <= q.rmse())
    }
}

impl Measured {
    /// Seconds of the quickest uniform sampling of the same error, between those that were measured; `None` where
    /// that is out of their reach.
    #[must_use]
    pub fn uniform_seconds(&self, rmse: f64) -> Option<f64> {
        let of = |method: Method| {
            let mut points: Vec<(f64, f64)> = self
                .points
                .iter()
                .filter(|p| p.method == method && p.metrics.rmse > 0.0)
                .map(|p| (p.metrics.rmse.ln(), p.trace.as_secs_f64().max(1e-9).ln()))
                .collect();
            points.sort_by(|a, b| a.1.total_cmp(&b.1));
            let at = rmse.ln();
            points
                .windows(2)
                .filter(|w| (w[1].0..=w[0].0).contains(&at) && w[0].0 > w[1].0)
                .map(|w| {
                    let share = (w[0].0 - at) / (w[0].0 - w[1].0);
                    (w[0].1 + share * (w[1].1 - w[0].1)).exp()
                })
                .min_by(f64::total_cmp)
        };
        [Method::Samples, Method::Scrambled].into_iter().filter_map(of).min_by(f64::total_cmp)
    }

    /// The recommended point.
    #[must_use]
    pub fn recommended(&self) -> Option<&Point> {
        self.recommendation.as_ref().and_then(|r| self.points.get(r.point))
    }
}
