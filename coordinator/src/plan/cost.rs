//! What passes cost, in points a pixel, and how many pixels are worth an audit.
//!
//! Under a tolerance t a pixel whose points are worth it gets n of them and keeps a squared error e² of
//! n / n₁ · t², where n₁ is what a typical edge gets (see `core::sampling::pixel`). So expected errors tell points.

use std::time::Duration;

use tessera_core::film::ErrorEstimate;
use tessera_core::settings::{AuditRate, Tolerance};

use super::model::MODEL;

/// Expected points a pixel, without an audit, where `error` was expected within `tolerance`.
pub(super) fn points(error: &ErrorEstimate, tolerance: Tolerance) -> f64 {
    let t = tolerance.fraction();
    MODEL.first_points + tolerance.typical_points() * relative(error, t)
}

/// Mean squared error that is expected, in squares of the tolerance.
fn relative(error: &ErrorEstimate, t: f64) -> f64 {
    if error.pixels == 0 { 0.0 } else { error.expected.value().max(0.0) / (error.pixels as f64 * t * t) }
}

/// The audit of a pass over `area` pixels, and how many of them it is expected to draw, by how many were drawn of
/// the picture, or of a part of it, at which rate.
pub(super) fn audit(area: u64, seen: Option<(&ErrorEstimate, AuditRate)>) -> (AuditRate, f64) {
    let all = area as f64;
    if area <= MODEL.small {
        return (AuditRate::ALL, all);
    }
    let share = match seen {
        Some((error, rate)) if error.audited > 0 && rate != AuditRate::ALL => {
            (error.audited as f64 / (error.pixels as f64 * rate.factor())).max(1e-3)
        }
        _ => MODEL.drawn,
    };
    let drawn = (all * share).max(1.0);
    let rate = (MODEL.audited / drawn).min(MODEL.most_rate.max(MODEL.audited_at_least / drawn));
    (AuditRate((rate * 65536.0).ceil() as u32), (rate * drawn).min(all))
}

/// The audit of a coarse pass, whose pixels are all alike to it: so many of them.
pub(super) fn coarse_audit(area: u64, pixels: f64) -> AuditRate {
    let rate = pixels / (area as f64 * AuditRate::FLOOR);
    AuditRate((rate * 65536.0).ceil() as u32)
}

/// Time that other errors would take, by the model above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forecast {
    rmse: f64,
    /// Points a pixel beyond the first.
    more: f64,
    took: Duration,
}

impl Forecast {
    /// From a picture that was rendered within `tolerance` in so much time.
    pub(crate) fn new(error: &ErrorEstimate, tolerance: Tolerance, took: Duration) -> Self {
        Self { rmse: error.rmse(), more: points(error, tolerance) - MODEL.first_points, took }
    }

    /// Seconds of tracing until an error of `target`; `None` where it was reached already.
    #[must_use]
    pub fn seconds(&self, target: f64) -> Option<f64> {
        let finer = self.rmse / (MODEL.most_aim * target);
        if self.rmse <= target || !finer.is_finite() {
            return None;
        }
        // Errors fall with the tolerance, points rise faster with its inverse; once that is so, pixels that
        // were content with less will be among those that are refined.
        let more = (self.more + 0.1 * MODEL.first_points) * libm::pow(finer, MODEL.points_power);
        Some(self.took.as_secs_f64() * (MODEL.first_points + more) / (MODEL.first_points + self.more))
    }
}
