//! What a tile is to blame for, and what is not its fault.
//!
//! A tile may fail wherever it is tried, and may even kill its workers. But most workers are lost for other
//! reasons: a switch, a batch system, somebody's hand. A tile gets a *strike* when a worker reports that it failed
//! at it, or when a worker is lost that was rendering it, unless
//!
//! - other workers were lost within [`together`](super::Model::together) of it, and not at the same tile one after
//!   another: they have a cause in common,
//! - this process stood still not long ago, or
//! - the same worker comes back: then the tile did not kill it.
//!
//! Strikes end a render only where they come from workers that are known to deliver. Those of strangers count as
//! long as nobody else is there: three reports, or [`LOSSES_OF_STRANGERS`] losses over as long as one would
//! wait for workers.

use std::time::Duration;

use tessera_core::film::Region;
use tessera_proto::InstanceId;

use super::{Effect, End, Scheduler, Tile, WorkerKey};

/// Workers that fail at a tile, or reports of failure, that end the render.
pub(super) const STRIKES: usize = 3;
/// Failures of any kind that end the render, so that one worker cannot fail at a tile for ever.
const STRIKES_IN_ALL: usize = 8;
/// Failures with no delivery between them that end a render in which nobody ever delivered.
const FAILURES_AT_FIRST: usize = 24;
/// Workers that never delivered and were lost at a tile, that may end the render.
pub(super) const LOSSES_OF_STRANGERS: usize = 20;
/// Losses that wait to be judged, at most.
const MAX_LOSSES: usize = 4096;

/// One failure of a tile.
#[derive(Debug)]
pub(super) struct Strike {
    instance: InstanceId,
    /// Whether the worker said so, rather than being lost with it.
    reported: bool,
    /// Whether that worker was known to deliver.
    proven: bool,
    at: Duration,
}

/// What a worker was rendering when it was lost.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtWork {
    pub(super) tile: u64,
    pub(super) region: Region,
    pub(super) granted: Duration,
}

/// Whether two regions have a pixel in common.
fn overlap(a: &Region, b: &Region) -> bool {
    a.x0 < b.x1 && b.x0 < a.x1 && a.y0 < b.y1 && b.y0 < a.y1
}

/// A worker that was lost, and what it was rendering.
#[derive(Debug)]
pub(super) struct Loss {
    at: Duration,
    instance: InstanceId,
    proven: bool,
    /// In doubt until the loss is judged; empty where they turned out not to be.
    tiles: Vec<u64>,
    /// All that it was rendering.
    rendered: Vec<Region>,
    cause: String,
}

impl Loss {
    /// Of a worker that was rendering tiles since the times given.
    pub(super) fn new(at: Duration, (instance, proven): (InstanceId, bool), at_work: &[AtWork], cause: &str) -> Self {
        let rendered = at_work.iter().map(|a| a.region).collect();
        Self { at, instance, proven, tiles: Vec::new(), rendered, cause: cause.into() }
    }

    /// Whether another worker, lost later, was given something afterwards that this one was rendering: then that
    /// may be what both were lost for.
    fn is_followed_by(&self, at_work: &[AtWork]) -> bool {
        let shared = |a: &AtWork| self.rendered.iter().any(|r| overlap(r, &a.region));
        at_work.iter().any(|a| a.granted >= self.at && shared(a))
    }
}

impl Tile {
    /// Failures and losses that it may be to blame for.
    pub(super) fn doubt(&self) -> usize {
        self.doubts + self.strikes.len()
    }

    /// Whether there are any.
    pub(super) fn is_doubtful(&self) -> bool {
        self.doubt() > 0
    }

    /// Workers that it has a strike from, each once.
    pub(super) fn strikers(&self) -> Vec<InstanceId> {
        let mut instances: Vec<_> = self.strikes.iter().map(|s| s.instance).collect();
        instances.sort_unstable();
        instances.dedup();
        instances
    }

    /// Whether it failed too often. `alone`: nobody is there who is known to deliver.
    fn is_out(&self, alone: bool, patience: Duration, now: Duration) -> bool {
        let counts = |s: &&Strike| s.proven || (alone && s.reported);
        let reported = self.strikes.iter().filter(counts).filter(|s| s.reported).count();
        let mut instances: Vec<_> = self.strikes.iter().filter(counts).map(|s| s.instance).collect();
        let all = instances.len();
        instances.sort_unstable();
        instances.dedup();
        let strangers = self.strikes.iter().filter(|s| !s.proven && !s.reported).count();
        let first = self.strikes.first().map_or(now, |s| s.at);
        reported.max(instances.len()) >= STRIKES
            || all >= STRIKES_IN_ALL
            || (alone && strangers >= LOSSES_OF_STRANGERS && now.saturating_sub(first) >= patience)
    }
}

impl Scheduler {
    /// Notices that this process stood still: nobody could be heard, and connections may have broken.
    pub(super) fn forgive_after_a_stall(&mut self, now: Duration) {
        if now > self.now + self.config.model.stall {
            for w in self.workers.values_mut() {
                w.last_heard = now;
                w.last_answer = w.last_answer.max(now);
            }
            self.amnesty_until = now + self.config.model.amnesty;
            self.pardon_all();
        }
    }

    /// A worker said that it failed at a tile.
    pub(super) fn failed(&mut self, id: u64, worker: WorkerKey, cause: &str, effects: &mut Vec<Effect>) {
        let Some((instance, proven)) = self.workers.get(&worker).map(|w| (w.instance, w.proven)) else {
            return self.release(id);
        };
        self.failures += 1;
        self.strike(id, Strike { instance, reported: true, proven, at: self.now }, cause, effects);
        if self.failures >= FAILURES_AT_FIRST && self.tiles_done == 0 && self.crowd.proven == 0 {
            self.tile_failed(id, cause, effects);
        }
    }

    fn strike(&mut self, id: u64, strike: Strike, cause: &str, effects: &mut Vec<Effect>) {
        let Some(tile) = self.tiles.get_mut(&id) else { return };
        tile.strikes.push(strike);
        self.doubtful.insert(id);
        if tile.is_out(self.crowd.proven == 0, self.config.patience.lost, self.now) {
            self.tile_failed(id, cause, effects);
        } else {
            self.want(id);
        }
    }

    fn tile_failed(&mut self, id: u64, cause: &str, effects: &mut Vec<Effect>) {
        let Some(tile) = self.tiles.get(&id) else { return };
        let (region, attempts) = (tile.region, tile.strikes.len() as u32);
        self.end(End::TileFailed { region, attempts, cause: cause.into() }, effects);
    }

    /// A worker was lost. What it was rendering, and since when, is in doubt until it is known whether others were
    /// lost with it.
    pub(super) fn lost(&mut self, mut loss: Loss, at_work: &[AtWork]) {
        let forgiven = self.now < self.amnesty_until;
        let near = |l: &&Loss| l.instance != loss.instance && self.now <= l.at + self.config.model.together;
        let together = self.losses.iter().filter(near).any(|l| !l.is_followed_by(at_work));
        if together {
            self.pardon_all();
        }
        for &AtWork { tile: id, .. } in at_work {
            match self.tiles.get_mut(&id) {
                Some(tile) if !forgiven && !together => {
                    tile.doubts += 1;
                    if tile.doubt() > 1 {
                        tile.again_at = self.now + self.config.model.pause;
                    }
                    loss.tiles.push(id);
                    self.doubtful.insert(id);
                    self.want(id);
                }
                _ => self.release(id),
            }
        }
        self.losses_in_a_row += 1;
        self.losses.push_back(loss);
        if self.losses.len() > MAX_LOSSES
            && let Some(oldest) = self.losses.pop_front()
        {
            self.pardon(&oldest.tiles);
        }
    }

    /// The losses that are not judged yet are no tile's fault.
    fn pardon_all(&mut self) {
        let tiles: Vec<u64> = self.losses.iter_mut().flat_map(|l| std::mem::take(&mut l.tiles)).collect();
        self.pardon(&tiles);
    }

    fn pardon(&mut self, tiles: &[u64]) {
        for &id in tiles {
            if let Some(tile) = self.tiles.get_mut(&id) {
                tile.doubts -= 1;
            }
            self.settle(id);
        }
    }

    /// Brings a tile that may not be in doubt any more up to date.
    fn settle(&mut self, id: u64) {
        if self.tiles.get(&id).is_some_and(|t| !t.is_doubtful()) {
            self.doubtful.remove(&id);
        }
        self.release(id);
    }

    /// A worker comes back: whatever it was rendering when its connection broke did not kill it.
    pub(super) fn returns(&mut self, instance: InstanceId) {
        let mut tiles = Vec::new();
        for loss in self.losses.iter_mut().filter(|l| l.instance == instance) {
            tiles.append(&mut loss.tiles);
        }
        self.pardon(&tiles);
        for id in self.doubtful.iter().copied().collect::<Vec<_>>() {
            if let Some(tile) = self.tiles.get_mut(&id) {
                tile.strikes.retain(|s| s.reported || s.instance != instance);
            }
            self.settle(id);
        }
    }

    /// Judges the losses that nobody else's came with.
    pub(super) fn judge_losses(&mut self, effects: &mut Vec<Effect>) {
        while self.losses.front().is_some_and(|l| self.now > l.at + self.config.model.together) {
            let Some(loss) = self.losses.pop_front() else { return };
            for id in loss.tiles {
                let Some(tile) = self.tiles.get_mut(&id) else { continue };
                tile.doubts -= 1;
                let strike = Strike { instance: loss.instance, reported: false, proven: loss.proven, at: loss.at };
                self.strike(id, strike, &loss.cause, effects);
            }
        }
    }
}
