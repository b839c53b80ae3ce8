//! How large a tile should be, and how long one takes.

use std::time::Duration;

use super::{Scheduler, WorkerKey};

impl Scheduler {
    /// How long all workers together will take for what is not done, if that is known.
    pub(super) fn rest(&self) -> Duration {
        let rate = self.crowd.rate(self.typical);
        let pixels = self.cutter.pixels_left() as f64 + self.crowd.held as f64;
        if rate > 0.0 { Duration::from_secs_f64((pixels / rate).min(1e9)) } else { Duration::MAX }
    }

    /// Pixels that suit `worker` now.
    pub(super) fn area_for(&self, worker: WorkerKey) -> u64 {
        let Some(w) = self.workers.get(&worker) else { return 0 };
        let (model, left) = (&self.config.model, self.cutter.pixels_left() as f64);
        let missing = self.config.expected.saturating_sub(self.crowd.count) as f64;
        let Some(rate) = self.rate_of(worker) else {
            let share = f64::from(w.threads) / (self.crowd.threads as f64 + missing);
            let probe = model.probe * f64::from(w.threads) / f64::from(self.config.samples);
            return (left * share / model.parts).max(model.least_probe).min(probe.max(model.least)) as u64;
        };
        let all = self.crowd.rate(self.typical);
        // A part of its share of what is left, and less where tiles differ in their cost: one that is as dear as
        // the dearest so far must not keep the others waiting at the end.
        let spread = w.slowest.map_or(1.0, |slowest| (rate / slowest).clamp(1.0, model.most_spread));
        let fair = left * rate / (all + missing * rate) / (model.parts * spread.sqrt());
        let shortest = model.shortest.max(model.each * self.crowd.count as u32);
        let longest = model.longest.max(2 * shortest);
        let (shortest, longest) = (rate * shortest.as_secs_f64(), rate * longest.as_secs_f64());
        // Two at least are on their way.
        let carried = w.line.window().map_or(f64::INFINITY, |window| window / 2.0);
        // The ceiling is what counts where the two disagree: a slow worker's least is still little.
        fair.min(carried).max(shortest).min(longest).max(model.least) as u64
    }

    /// Pixels a second of `worker`, by its own measure or by that of others.
    pub(super) fn rate_of(&self, worker: WorkerKey) -> Option<f64> {
        let w = self.workers.get(&worker)?;
        w.pace().or_else(|| self.typical.map(|rate| rate * f64::from(w.threads)))
    }

    /// How long `worker` renders so many pixels; a second where nothing is known.
    pub(super) fn time_for(&self, worker: WorkerKey, area: u64) -> Duration {
        let rate = self.rate_of(worker);
        rate.map_or(Duration::from_secs(1), |r| Duration::from_secs_f64((area as f64 / r.max(1e-3)).min(1e9)))
    }
}
