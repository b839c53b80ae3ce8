//! The passes of a render, and what is known of the picture after them.

use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region, Sum};
use tessera_core::settings::{Detail, Pass};

use crate::plan::{Forecast, Outcome};

/// The passes so far.
#[derive(Default)]
pub(super) struct Passing {
    /// The pass at hand.
    pub(super) at_hand: Outcome,
    pub(super) began: Duration,
    pub(super) kept: bool,
    pub(super) detail: Option<Pass>,
    /// Of the last whole picture.
    pub(super) picture: Outcome,
    /// Passes begun, and passes of those that are in the picture as a whole.
    pub(super) begun: u32,
    pub(super) whole: u32,
    /// How closely the last whole picture was looked at; before there is one, the picture at hand.
    pub(super) pass: Option<Pass>,
    /// Whether time was up before the plan was done.
    pub(super) timed_out: bool,
}

impl Passing {
    /// The estimate of the picture as it is: what the pass at hand has not replaced is as it was before.
    pub(super) fn error(&self) -> ErrorEstimate {
        let (old, new) = (&self.picture, &self.at_hand);
        if !self.kept || new.error.pixels == 0 || old.error.pixels <= new.error.pixels {
            return if self.whole > 0 { old.error } else { new.error };
        }
        let mut sum = new.error;
        for (region, error) in &old.tiles {
            let covered: u64 = new.tiles.iter().map(|(r, _)| common(r, region)).sum();
            let left = region.area() - covered.min(region.area());
            if left > 0 {
                let part = left as f64 / region.area() as f64;
                let share = |sum: Sum| Sum::new(part * sum.value());
                sum += ErrorEstimate {
                    pixels: left,
                    expected: share(error.expected),
                    audited: (part * error.audited as f64).round() as u64,
                    squares: share(error.squares),
                    variance: share(error.variance),
                };
            }
        }
        sum
    }

    /// What other errors would take, where the last whole picture tells.
    pub(super) fn forecast(&self) -> Option<Forecast> {
        match self.pass?.detail {
            Detail::Within(tolerance) if self.whole > 0 => {
                Some(Forecast::new(&self.picture.error, tolerance, self.picture.took))
            }
            _ => None,
        }
    }
}

/// Pixels that two regions share.
fn common(a: &Region, b: &Region) -> u64 {
    let overlap = |a0: u32, a1: u32, b0: u32, b1: u32| u64::from(a1.min(b1).saturating_sub(a0.max(b0)));
    overlap(a.x0, a.x1, b.x0, b.x1) * overlap(a.y0, a.y1, b.y0, b.y1)
}
