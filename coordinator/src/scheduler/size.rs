//! How large a tile should be, and who helps whom at the end.

use std::time::Duration;

use tessera_proto::LeaseId;

use super::worker::Worker;
use super::{Effect, LONGEST, MAX_COPIES, MAX_DEPTH, SHORTEST, Scheduler, Tile, WorkerKey};

/// Pixels that one thread is given while nothing is measured, at one sample a pixel.
const PROBE: f64 = 4096.0;
/// The least pixels worth a tile while nothing is measured.
const LEAST_PROBE: f64 = 256.0;
/// Work that a worker is given ahead: on a machine whose cores all render, its answers and the
/// next leases wait for their turn about as long.
const AHEAD: Duration = Duration::from_millis(10);
/// One part of a picture counts as at most so many times as dear as it is on the whole.
const MOST_SPREAD: f64 = 16.0;
/// Only what is overdue by this much more is taken to be overdue.
const SLACK: Duration = Duration::from_millis(20);

impl Scheduler {
    /// Gives leases to everyone who has room for them.
    pub(super) fn grant_all(&mut self, effects: &mut Vec<Effect>) {
        // One lease each in turn, so that the first to come does not take it all.
        loop {
            let rest = self.rest();
            let mut with_room: Vec<(usize, WorkerKey)> = self
                .workers
                .iter()
                .filter(|(_, w)| w.is_fit() && self.has_room(w, rest))
                .map(|(&k, w)| (w.leases.len(), k))
                .collect();
            with_room.sort_unstable();
            let before = self.open.len();
            for (_, worker) in with_room {
                if let Some(tile) = self.next_for(worker) {
                    self.grant(worker, tile, effects);
                }
            }
            if self.open.len() == before {
                break;
            }
        }
        self.assist(effects);
    }

    /// Pixels that `worker` holds.
    fn held(&self, worker: &Worker) -> f64 {
        worker.leases.iter().map(|l| self.tiles[&self.open[l].tile].region.area() as f64).sum()
    }

    /// How long all workers together will take for what is not done, if that is known.
    fn rest(&self) -> Duration {
        let fit = || self.workers.iter().filter(|(_, w)| w.is_fit());
        let rate: f64 = fit().filter_map(|(&k, _)| self.rate_of(k)).sum();
        let pixels = self.cutter.pixels_left() as f64 + fit().map(|(_, w)| self.held(w)).sum::<f64>();
        if rate > 0.0 { Duration::from_secs_f64((pixels / rate).min(1e9)) } else { Duration::MAX }
    }

    /// Whether `worker` should be given more, where all will take `rest` for what there is.
    fn has_room(&self, worker: &Worker, rest: Duration) -> bool {
        let leases = worker.leases.len();
        match worker.rate {
            _ if leases < worker.depth => true,
            _ if leases >= MAX_DEPTH => false,
            None => false,
            // Not what others will be waiting for.
            Some(rate) => Duration::from_secs_f64((self.held(worker) / rate.max(1.0)).min(1e9)) < AHEAD.min(rest / 2),
        }
    }

    /// The next tile for `worker`: one that failed elsewhere, else one cut for it.
    fn next_for(&mut self, worker: WorkerKey) -> Option<u64> {
        let instance = self.workers[&worker].instance;
        let place = self.waiting.iter().position(|id| {
            let tile = &self.tiles[id];
            let fresh_worker = || self.workers.values().any(|w| w.is_fit() && !tile.struck_by(w.instance));
            !tile.struck_by(instance) || !fresh_worker()
        });
        if let Some(place) = place {
            return self.waiting.remove(place);
        }
        let region = self.cutter.take(self.area_for(worker))?;
        let id = self.next_tile;
        self.next_tile += 1;
        let tile = Tile { region, number: self.number, leases: Vec::new(), attempts: 0, strikes: Vec::new() };
        self.tiles.insert(id, tile);
        Some(id)
    }

    /// Pixels that suit `worker` now.
    fn area_for(&self, worker: WorkerKey) -> u64 {
        let w = &self.workers[&worker];
        let left = self.cutter.pixels_left() as f64;
        let crowd = self.workers.values().filter(|w| w.is_fit());
        let threads: f64 = crowd.clone().map(|w| f64::from(w.threads)).sum();
        let missing = self.config.expected.saturating_sub(crowd.clone().count()) as f64;
        let share = f64::from(w.threads) / (threads + missing);
        let Some(rate) = self.rate_of(worker) else {
            let probe = PROBE * f64::from(w.threads) / f64::from(self.config.samples);
            return (left * share / 4.0).max(LEAST_PROBE).min(probe.max(64.0)) as u64;
        };
        let all: f64 = self.workers.iter().filter(|(_, w)| w.is_fit()).filter_map(|(&k, _)| self.rate_of(k)).sum();
        // A quarter of what is left, and less where tiles differ in their cost: one that is as dear as
        // the dearest so far must not keep the others waiting at the end.
        let spread = w.slowest.map_or(1.0, |slowest| (rate / slowest).clamp(1.0, MOST_SPREAD));
        let fair = left * rate / (all + missing * rate) / (4.0 * spread.sqrt());
        // The ceiling is what counts where the two disagree: a slow worker's least is still little.
        fair.max(rate * SHORTEST.as_secs_f64()).min(rate * LONGEST.as_secs_f64()).max(64.0) as u64
    }

    /// Pixels a second of `worker`, by its own measure or by that of others.
    fn rate_of(&self, worker: WorkerKey) -> Option<f64> {
        let w = &self.workers[&worker];
        w.rate.or_else(|| {
            let (mut rate, mut threads) = (0.0, 0.0);
            for other in self.workers.values() {
                if let Some(r) = other.rate {
                    rate += r;
                    threads += f64::from(other.threads);
                }
            }
            (threads > 0.0).then(|| rate / threads * f64::from(w.threads))
        })
    }

    /// At the end, lets idle workers render what others will finish late: the latest first.
    fn assist(&mut self, effects: &mut Vec<Effect>) {
        self.assist_at = None;
        if self.cutter.pixels_left() > 0 || !self.waiting.is_empty() {
            return;
        }
        let idle: Vec<WorkerKey> =
            self.workers.iter().filter(|(_, w)| w.is_fit() && w.leases.is_empty()).map(|(&k, _)| k).collect();
        for worker in idle {
            let instance = self.workers[&worker].instance;
            let mut latest: Option<(Duration, u64)> = None;
            for (&id, tile) in &self.tiles {
                let held = tile.leases.iter().any(|l| self.open[l].worker == worker);
                if held || tile.leases.is_empty() || tile.leases.len() >= MAX_COPIES || tile.struck_by(instance) {
                    continue;
                }
                let own = self.time_for(worker, tile.region.area());
                let (rest, due) = self.expected_rest(tile);
                // What nobody has begun is taken off its holder as soon as that is quicker.
                let slack = if tile.leases.iter().any(|l| self.is_begun(l)) { SLACK / 4 } else { SHORTEST / 4 };
                if rest > own.mul_f64(1.25) + slack {
                    if latest.is_none_or(|(r, _)| rest > r) {
                        latest = Some((rest, id));
                    }
                } else if let Some(due) = due {
                    self.assist_at = Some(self.assist_at.map_or(due, |at| at.min(due)));
                }
            }
            if let Some((_, tile)) = latest {
                self.grant(worker, tile, effects);
            }
        }
    }

    /// Whether its holder is likely to render `lease` by now.
    fn is_begun(&self, lease: &LeaseId) -> bool {
        let holder = &self.workers[&self.open[lease].worker];
        holder.leases.iter().take(holder.running).any(|l| l == lease)
    }

    fn time_for(&self, worker: WorkerKey, area: u64) -> Duration {
        self.rate_of(worker).map_or(Duration::from_secs(1), |rate| Duration::from_secs_f64(area as f64 / rate.max(1.0)))
    }

    /// How long the tile's holders will still take for it, by their speed so far, and when that
    /// will have turned out to be wrong. A holder that is overdue or silent will take for ever.
    fn expected_rest(&self, tile: &Tile) -> (Duration, Option<Duration>) {
        let mut best = (Duration::MAX, None);
        for lease in &tile.leases {
            let open = &self.open[lease];
            let holder = &self.workers[&open.worker];
            let began =
                holder.leases.front().map_or(self.now, |first| self.open[first].granted.max(holder.last_delivery));
            let before: u64 = holder
                .leases
                .iter()
                .take_while(|l| *l != lease)
                .map(|l| self.tiles[&self.open[l].tile].region.area())
                .sum();
            let whole = self.time_for(open.worker, before + tile.region.area());
            let due = began + 2 * whole + SLACK;
            let rest = if holder.suspect || self.now >= due {
                Duration::MAX
            } else {
                (began + whole).saturating_sub(self.now)
            };
            if rest < best.0 {
                best = (rest, Some(due));
            }
        }
        best
    }
}
