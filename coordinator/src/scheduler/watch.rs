//! Whether workers are heard of, whether they get on, and whether there are any.

use std::time::Duration;

use super::worker::{Phase, Worker};
use super::{CutOff, Effect, End, Scheduler, WorkerKey};

impl Scheduler {
    pub(super) fn heard(&mut self, worker: WorkerKey) {
        let Some(w) = self.workers.get_mut(&worker) else { return };
        w.last_heard = self.now;
        if std::mem::take(&mut w.suspect) {
            self.revalue(worker);
        }
    }

    /// A worker gives an answer: it is not stuck, or not any more.
    pub(super) fn recover(&mut self, worker: WorkerKey) {
        let Some(w) = self.workers.get_mut(&worker) else { return };
        if std::mem::take(&mut w.stuck) {
            self.revalue(worker);
        }
    }

    /// A worker's leases count from now on, or do not any more.
    fn revalue(&mut self, worker: WorkerKey) {
        self.refresh(worker);
        let Some(w) = self.workers.get(&worker) else { return };
        let tiles: Vec<u64> = w.leases.iter().filter_map(|l| self.open.get(l)).map(|o| o.tile).collect();
        for tile in tiles {
            self.want(tile);
        }
    }

    /// Looks at all workers: who fell silent, who never got ready, who does not get on.
    pub(super) fn check(&mut self, effects: &mut Vec<Effect>) {
        let (mut changed, mut cut, mut stuck) = (Vec::new(), Vec::new(), Vec::new());
        for (&key, w) in &self.workers {
            let silent = self.now.saturating_sub(w.last_heard);
            if (silent >= self.config.suspect_after) != w.suspect {
                changed.push(key);
            }
            match w.phase {
                _ if silent >= self.config.dead_after => cut.push((key, CutOff::Silent(silent))),
                Phase::Preparing { since } if self.now.saturating_sub(since) >= self.config.prepare_within => {
                    cut.push((key, CutOff::Unready(self.config.prepare_within)));
                }
                _ if !w.stuck && self.stuck_at(key, w).is_some_and(|at| self.now >= at) => stuck.push(key),
                _ => {}
            }
        }
        for worker in changed {
            if let Some(w) = self.workers.get_mut(&worker) {
                w.suspect = !w.suspect;
            }
            self.revalue(worker);
        }
        for (worker, why) in cut {
            self.cut_off(worker, why, effects);
        }
        for worker in stuck {
            self.stuck(worker, effects);
        }
        self.judge_losses(effects);
        let patience = self.config.patience.first.min(self.config.patience.lost);
        let pause = (self.config.suspect_after / 8).min(patience / 4).max(Duration::from_millis(1));
        self.check_at = self.now + pause;
    }

    /// When it will be clear that a worker does not get on with what it holds.
    fn stuck_at(&self, key: WorkerKey, w: &Worker) -> Option<Duration> {
        let (model, front) = (&self.config.model, self.open.get(w.leases.front()?)?);
        let area = self.tiles.get(&front.tile)?.region.area();
        let usual = self.time_for(key, area);
        // What it renders beside it has its share of its threads.
        let dearest = usual.max(slow(area, w.slowest).min(model.stuck_spread * usual)) * w.running as u32;
        Some(w.last_answer.max(front.granted) + model.stuck * (dearest + w.line.lag()) + model.stuck_slack)
    }

    /// A worker beats but does not get on: what it has not begun is taken from it, what it has begun is wanted
    /// of others too, and it gets no more before it delivers.
    fn stuck(&mut self, worker: WorkerKey, effects: &mut Vec<Effect>) {
        let Some(w) = self.workers.get_mut(&worker) else { return };
        w.stuck = true;
        let waiting: Vec<_> = w.leases.iter().skip(w.running).copied().collect();
        for lease in waiting.into_iter().rev() {
            let tile = self.open.get(&lease).map(|o| o.tile);
            self.revoke(lease, effects);
            if let Some(tile) = tile {
                self.release(tile);
            }
        }
        self.revalue(worker);
    }

    /// Ends the render where nobody has been there for too long.
    pub(super) fn check_deserted(&mut self, effects: &mut Vec<Effect>) {
        if !self.workers.is_empty() {
            self.deserted_since = None;
            return;
        }
        let since = *self.deserted_since.get_or_insert(self.now);
        let waited = self.now - since;
        let patience = if self.ever { self.config.patience.lost } else { self.config.patience.first };
        if waited >= patience {
            self.end(End::NoWorkers { waited, ever: self.ever }, effects);
        }
    }
}

/// How long so many pixels take that are as dear as any so far.
fn slow(area: u64, slowest: Option<f64>) -> Duration {
    slowest.map_or(Duration::ZERO, |rate| Duration::from_secs_f64((area as f64 / rate.max(1e-3)).min(1e9)))
}
