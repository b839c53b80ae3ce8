//! Passes until time is up: coarse ones first, each whole, then within ever tighter tolerances.

use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::settings::{AuditRate, Detail, Pass, Tolerance};

use super::cost;
use super::model::MODEL;
use super::{Outcome, Step, reaches, within};

/// See the [module](self).
#[derive(Debug)]
pub(crate) struct Timed {
    limit: Duration,
    error: Option<f64>,
    region: Region,
    /// Of the pass at hand.
    detail: Detail,
    /// Of the last pass that was not coarse.
    audit: Option<AuditRate>,
}

impl Timed {
    pub(super) fn new(limit: Duration, error: Option<f64>, region: Region) -> Self {
        Self { limit, error, region, detail: Detail::Coarse { step: MODEL.coarse_step }, audit: None }
    }

    pub(super) fn limit(&self) -> Duration {
        self.limit
    }

    pub(super) fn error(&self) -> Option<f64> {
        self.error
    }

    pub(super) fn first(&mut self) -> Step {
        self.coarse(MODEL.coarse_step, 1.0)
    }

    pub(super) fn next(&mut self, outcome: &Outcome) -> Option<Step> {
        if self.error.is_some_and(|e| reaches(&outcome.error, e)) {
            return None;
        }
        let left = self.limit.saturating_sub(outcome.now).as_secs_f64();
        if left <= 0.0 {
            return None;
        }
        let took = outcome.took.as_secs_f64().max(1e-4);
        match self.detail {
            Detail::Coarse { step } => {
                let points = f64::from(step * step);
                // The first pass also waited for whatever begins slowly: the next one shows how quick they are.
                let finest =
                    (1..step.ilog2()).map(|k| 1 << k).find(|s| took * points / f64::from(s * s) < MODEL.share * left);
                match finest {
                    _ if took * points * MODEL.timed_points < left => {
                        Some(self.fine(MODEL.timed_tolerance, points * MODEL.timed_points, outcome))
                    }
                    Some(finer) => Some(self.coarse(finer, points / f64::from(finer * finer))),
                    // Part of the picture is better than none of it.
                    None if step > 2 => Some(self.coarse(step / 2, 4.0)),
                    None => Some(self.fine(MODEL.timed_tolerance, points * MODEL.timed_points, outcome)),
                }
            }
            Detail::Within(t) | Detail::Glance(t) if t == Tolerance::MIN => None,
            Detail::Within(tolerance) | Detail::Glance(tolerance) => {
                let times = (left * MODEL.share / took).max(1.0);
                let mut finer = libm::pow(times, 1.0 / MODEL.time_power).clamp(1.5, 16.0);
                if let Some(e) = self.error {
                    // No finer than the error asked for needs.
                    finer = finer.min((outcome.error.interval().1 / (MODEL.most_aim * e)).max(1.2));
                }
                Some(self.fine(tolerance.fraction() / finer, libm::pow(finer, MODEL.time_power), outcome))
            }
        }
    }

    fn coarse(&mut self, step: u32, dearer: f64) -> Step {
        self.detail = Detail::Coarse { step };
        let audit = cost::coarse_audit(self.region.area(), MODEL.coarse_audited);
        Step { pass: Some(Pass { detail: self.detail, audit }), regions: Vec::new(), kept: true, dearer }
    }

    /// The next picture, its worst parts first.
    fn fine(&mut self, fraction: f64, dearer: f64, outcome: &Outcome) -> Step {
        let (audit, _) = cost::audit(self.region.area(), self.audit.map(|rate| (&outcome.error, rate)));
        self.audit = Some(audit);
        let tolerance = Tolerance::new(fraction);
        self.detail = Detail::Within(tolerance);
        let mut tiles = outcome.tiles.clone();
        // Audits of single tiles are too few to go by; the order of equals is that of the picture.
        let gain = |(r, e): &(Region, ErrorEstimate)| e.expected.value() / r.area() as f64;
        tiles.sort_by(|a, b| gain(b).total_cmp(&gain(a)).then(a.0.cmp(&b.0)));
        let regions = tiles.into_iter().map(|(r, _)| r).collect();
        Step { pass: within(tolerance, audit), regions, kept: true, dearer }
    }
}
