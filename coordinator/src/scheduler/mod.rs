//! Who renders what, as a pure state machine: `(state, event, now) → effects`.
//!
//! It reads no clock, sends nothing and holds no pixels; whoever owns it tells
//! it what happened and when, and carries out what it asks for. `now` is the time
//! since the render began and never runs backwards.
//!
//! # A tile's states
//!
//! ```text
//!           cut for a worker with room
//!   uncut ──────────────────────────────▶ leased ─────▶ done
//!     ▲                                    │  ▲   first result, in the picture once
//!     │ given back, never tried            │  │
//!     └────────────────────────────────────┤  │ to a worker it has not failed on, if there is one
//!                 failed, or lost with its │  │
//!                 worker: one strike       ▼  │
//!                                        waiting ─────▶ the render ends
//!                                               three strikes
//! ```
//!
//! A leased tile has one to [`MAX_COPIES`] leases. All but the first are given to
//! workers that would otherwise be idle at the end, where the holder is expected to
//! finish later than they would, or is overdue, or silent.
//!
//! # A worker's states
//!
//! ```text
//!   joined ─▶ preparing ──▶ ready ◀──▶ suspect (silent for a while: no new leases)
//!                │            │           │
//!                │            ▼           ▼
//!                └────────▶ draining ──▶ gone
//! ```
//!
//! A lease that is not wanted any more is *revoked*: it is still the worker's duty to
//! answer it, and the answer is dropped. An answer to any other lease than those open or
//! revoked is a forgery, and ends the session.
//!
//! # Sizes
//!
//! Each worker gets a share of what is left, as large as its measured speed among all,
//! halved (guided self-scheduling after Polychronopoulos and Kuck, 1987), less where tiles have
//! turned out to cost very unlike amounts, but no more than [`LONGEST`] and no less than
//! [`SHORTEST`] of its time. A quick worker holds several, so that it has work while answers and
//! leases wait for a processor; what it has not begun at the end goes to whoever is idle.

mod cutter;
mod message;
mod size;
#[cfg(test)]
mod tests;
mod worker;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use tessera_core::film::Region;
use tessera_core::settings::Pass;
use tessera_proto::convert::Lease;
use tessera_proto::{Attempt, InstanceId, LeaseId, PassNumber};

use cutter::Cutter;
pub(crate) use message::{Config, CutOff, Effect, End, Event, WorkerKey};
use worker::{Phase, Worker};

/// The most of a worker's time that one tile should take.
pub(crate) const LONGEST: Duration = Duration::from_millis(100);
/// The least of a worker's time that is worth a tile of its own.
pub(crate) const SHORTEST: Duration = Duration::from_micros(1500);
/// Leases that one tile has at once, at most.
const MAX_COPIES: usize = 3;
/// Leases that one worker holds at once, at most.
const MAX_DEPTH: usize = 32;
/// Answers that a worker may owe to revoked leases.
const MAX_REVOKED: usize = 256;
/// Workers that fail at a tile, or reports of failure, that end the render.
const STRIKES: usize = 3;
/// Failures of any kind that end the render, so that one worker that keeps coming back cannot
/// fail for ever.
const STRIKES_IN_ALL: usize = 8;
/// A gap between two events that says that this process itself stood still.
const STALL: Duration = Duration::from_secs(1);

/// A region that was cut and is not done.
#[derive(Debug)]
struct Tile {
    region: Region,
    number: PassNumber,
    /// Open leases, the oldest first.
    leases: Vec<LeaseId>,
    attempts: u32,
    strikes: Vec<Strike>,
}

/// One failure of a tile.
#[derive(Debug)]
struct Strike {
    instance: InstanceId,
    /// Whether the worker said so, rather than being lost with it.
    reported: bool,
}

impl Tile {
    fn struck_by(&self, instance: InstanceId) -> bool {
        self.strikes.iter().any(|s| s.instance == instance)
    }

    /// Whether it failed too often.
    fn is_out(&self) -> bool {
        let reported = self.strikes.iter().filter(|s| s.reported).count();
        let mut instances: Vec<_> = self.strikes.iter().map(|s| s.instance).collect();
        instances.sort_unstable();
        instances.dedup();
        reported.max(instances.len()) >= STRIKES || self.strikes.len() >= STRIKES_IN_ALL
    }
}

/// A lease that is open.
#[derive(Debug)]
struct Open {
    worker: WorkerKey,
    tile: u64,
    attempt: Attempt,
    granted: Duration,
}

/// See the [module](self).
#[derive(Debug)]
pub(crate) struct Scheduler {
    config: Config,
    cutter: Cutter,
    tiles: BTreeMap<u64, Tile>,
    /// Tiles that failed and have no lease.
    waiting: VecDeque<u64>,
    open: BTreeMap<LeaseId, Open>,
    workers: BTreeMap<WorkerKey, Worker>,
    next_tile: u64,
    next_lease: u64,
    /// The pass at hand.
    number: PassNumber,
    /// How closely it looks; `None` where sampling is uniform.
    pass: Option<Pass>,
    /// Pixels of the pass at hand.
    pixels: u64,
    pixels_done: u64,
    tiles_done: u64,
    now: Duration,
    /// When the silence of workers is looked at next.
    check_at: Duration,
    /// When idle workers might take over an overdue tile.
    assist_at: Option<Duration>,
    /// Since when there is no worker.
    deserted_since: Option<Duration>,
    ever: bool,
    ended: bool,
}

impl Scheduler {
    /// Nothing leased, nobody there, at time 0.
    pub(crate) fn new(config: Config) -> Self {
        let cutter = Cutter::new(config.region, config.tile);
        Self {
            cutter,
            tiles: BTreeMap::new(),
            waiting: VecDeque::new(),
            open: BTreeMap::new(),
            workers: BTreeMap::new(),
            next_tile: 0,
            next_lease: 1,
            number: PassNumber(0),
            pass: None,
            pixels: config.region.area(),
            pixels_done: 0,
            tiles_done: 0,
            now: Duration::ZERO,
            check_at: Duration::ZERO,
            assist_at: None,
            deserted_since: Some(Duration::ZERO),
            ever: false,
            ended: false,
            config,
        }
    }

    /// Goes on after [`End::Complete`] with another pass, over disjoint `regions`, in their
    /// order, or over the whole region where there are none. Pixels are expected to cost
    /// `dearer` times as much as in the pass before.
    pub(crate) fn begin(&mut self, pass: Option<Pass>, regions: Vec<Region>, dearer: f64) {
        self.ended = false;
        self.number = PassNumber(self.number.0 + 1);
        self.pass = pass;
        (self.cutter, self.pixels) = if regions.is_empty() {
            (Cutter::new(self.config.region, self.config.tile), self.config.region.area())
        } else {
            let pixels = regions.iter().map(Region::area).sum();
            (Cutter::of(self.config.region, regions, self.config.tile), pixels)
        };
        (self.pixels_done, self.tiles_done) = (0, 0);
        for w in self.workers.values_mut() {
            w.rate = w.rate.map(|rate| rate / dearer.max(0.01));
            w.slowest = w.slowest.map(|rate| rate / dearer.max(0.01));
        }
    }

    /// Begins with `pass` and over `regions` instead of as the settings say.
    pub(crate) fn begin_first(&mut self, pass: Option<Pass>, regions: Vec<Region>) {
        self.begin(pass, regions, 1.0);
        self.number = PassNumber(0);
    }

    /// The region of a lease that `worker` holds and that is still wanted.
    pub(crate) fn region_of(&self, worker: WorkerKey, lease: LeaseId) -> Option<Region> {
        let open = self.open.get(&lease).filter(|o| o.worker == worker)?;
        self.tiles.get(&open.tile).map(|t| t.region)
    }

    /// How many leases `worker` holds.
    pub(crate) fn holds(&self, worker: WorkerKey) -> usize {
        self.workers.get(&worker).map_or(0, |w| w.leases.len())
    }

    /// How many tiles there will be in all, as far as can be said.
    pub(crate) fn tiles_estimate(&self) -> u64 {
        let typical = self.pixels_done.checked_div(self.tiles_done).unwrap_or(0);
        self.tiles_done + self.tiles.len() as u64 + self.cutter.regions_left(typical.max(1024))
    }

    /// When to send [`Event::Tick`] if nothing else happens before.
    pub(crate) fn wake_at(&self) -> Duration {
        self.assist_at.map_or(self.check_at, |at| at.min(self.check_at))
    }

    /// Takes in what happened and adds what is to be done to `effects`.
    pub(crate) fn handle(&mut self, event: Event, now: Duration, effects: &mut Vec<Effect>) {
        if self.ended {
            return;
        }
        if now > self.now + STALL {
            // Nobody could be heard while this process stood still.
            self.workers.values_mut().for_each(|w| w.last_heard = now);
        }
        self.now = self.now.max(now);
        match event {
            Event::Joined { worker, threads, instance } => {
                self.workers.insert(worker, Worker::new(threads, instance, self.now));
                self.ever = true;
            }
            Event::Ready { worker } => self.ready(worker, effects),
            Event::Heard { worker } => self.heard(worker),
            Event::Done { worker, lease, attempt, busy, idle } => {
                self.heard(worker);
                self.done(worker, lease, attempt, (busy, idle), effects);
            }
            Event::Failed { worker, lease, attempt, cause } => {
                self.heard(worker);
                if let Some(tile) = self.answered(worker, lease, attempt, effects) {
                    self.strike(tile, worker, true, &cause, effects);
                }
            }
            Event::Returned { worker, lease, attempt } => {
                self.heard(worker);
                self.returned(worker, lease, attempt, effects);
            }
            Event::Draining { worker } => {
                self.heard(worker);
                match self.workers.get_mut(&worker) {
                    Some(w) if w.phase == Phase::Draining => {
                        self.cut_off(worker, CutOff::Broke("it was leaving before".into()), effects);
                    }
                    Some(w) => w.phase = Phase::Draining,
                    None => {}
                }
            }
            Event::Broke { worker, rule } => self.cut_off(worker, CutOff::Broke(rule), effects),
            Event::Left { worker, cause } => self.gone(worker, Some(&cause), effects),
            Event::Tick => {}
        }
        if self.now >= self.check_at {
            self.check_silence(effects);
        }
        self.check_deserted(effects);
        if !self.ended {
            self.grant_all(effects);
        }
    }

    fn ready(&mut self, worker: WorkerKey, effects: &mut Vec<Effect>) {
        self.heard(worker);
        match self.workers.get_mut(&worker) {
            Some(w) if matches!(w.phase, Phase::Preparing { .. }) => w.phase = Phase::Ready,
            Some(w) if w.phase == Phase::Draining => {}
            Some(_) => self.cut_off(worker, CutOff::Broke("it was ready before".into()), effects),
            None => {}
        }
    }

    fn heard(&mut self, worker: WorkerKey) {
        if let Some(w) = self.workers.get_mut(&worker) {
            w.last_heard = self.now;
            w.suspect = false;
        }
    }

    /// Closes a lease that its worker answered, and gives its tile; `None` where the answer
    /// comes late or from nobody. Forgeries end the session.
    fn answered(
        &mut self,
        worker: WorkerKey,
        lease: LeaseId,
        attempt: Attempt,
        effects: &mut Vec<Effect>,
    ) -> Option<u64> {
        let w = self.workers.get_mut(&worker)?;
        if w.revoked.remove(&lease) {
            return None;
        }
        match self.open.get(&lease) {
            Some(open) if open.worker == worker && open.attempt == attempt => Some(self.close(lease)?.tile),
            _ => {
                let rule = format!("it answered lease {lease}, attempt {}, which it does not hold", attempt.0);
                self.cut_off(worker, CutOff::Broke(rule), effects);
                None
            }
        }
    }

    /// Forgets an open lease everywhere.
    fn close(&mut self, lease: LeaseId) -> Option<Open> {
        let open = self.open.remove(&lease)?;
        if let Some(tile) = self.tiles.get_mut(&open.tile) {
            tile.leases.retain(|l| *l != lease);
        }
        if let Some(w) = self.workers.get_mut(&open.worker) {
            w.leases.retain(|l| *l != lease);
        }
        Some(open)
    }

    fn done(
        &mut self,
        worker: WorkerKey,
        lease: LeaseId,
        attempt: Attempt,
        (busy, idle): (Duration, Duration),
        effects: &mut Vec<Effect>,
    ) {
        let was_full = self.workers.get(&worker).is_some_and(|w| w.leases.len() >= w.depth);
        let Some(tile) = self.answered(worker, lease, attempt, effects).and_then(|t| self.tiles.remove(&t)) else {
            return;
        };
        let area = tile.region.area();
        if let Some(w) = self.workers.get_mut(&worker) {
            w.delivered(area, busy, idle, was_full, self.now);
        }
        for other in tile.leases {
            let Some(open) = self.open.remove(&other) else { continue };
            let Some(w) = self.workers.get_mut(&open.worker) else { continue };
            w.leases.retain(|l| *l != other);
            w.revoked.insert(other);
            effects.push(Effect::Revoke { worker: open.worker, lease: other });
            if w.revoked.len() > MAX_REVOKED {
                self.cut_off(open.worker, CutOff::Broke("it leaves revoked leases unanswered".into()), effects);
            }
        }
        self.pixels_done += area;
        self.tiles_done += 1;
        effects.push(Effect::Accept { worker, region: tile.region });
        if self.pixels_done == self.pixels {
            self.end(End::Complete, effects);
        }
    }

    fn returned(&mut self, worker: WorkerKey, lease: LeaseId, attempt: Attempt, effects: &mut Vec<Effect>) {
        let draining = self.workers.get(&worker).is_some_and(|w| w.phase == Phase::Draining);
        if !draining && self.open.get(&lease).is_some_and(|o| o.worker == worker) {
            let rule = format!("it returned lease {lease} without leaving");
            return self.cut_off(worker, CutOff::Broke(rule), effects);
        }
        if let Some(tile) = self.answered(worker, lease, attempt, effects) {
            self.release(tile);
        }
    }

    /// A tile lost a lease through no fault of its own.
    fn release(&mut self, id: u64) {
        let Some(tile) = self.tiles.get(&id).filter(|t| t.leases.is_empty()) else { return };
        if tile.strikes.is_empty() {
            self.cutter.give_back(tile.region);
            self.tiles.remove(&id);
        } else {
            self.waiting.push_front(id);
        }
    }

    /// A tile failed, or was lost with its worker.
    fn strike(&mut self, id: u64, worker: WorkerKey, reported: bool, cause: &str, effects: &mut Vec<Effect>) {
        let Some(instance) = self.workers.get(&worker).map(|w| w.instance) else { return self.release(id) };
        let Some(tile) = self.tiles.get_mut(&id) else { return };
        tile.strikes.push(Strike { instance, reported });
        if tile.is_out() {
            let (region, attempts) = (tile.region, tile.strikes.len() as u32);
            self.end(End::TileFailed { region, attempts, cause: cause.into() }, effects);
        } else if tile.leases.is_empty() {
            self.waiting.push_front(id);
        }
    }

    fn cut_off(&mut self, worker: WorkerKey, why: CutOff, effects: &mut Vec<Effect>) {
        if !self.workers.contains_key(&worker) {
            return;
        }
        // Breaking a rule is the worker's failure and not its tiles'.
        let cause = match &why {
            CutOff::Broke(_) => None,
            CutOff::Silent(_) | CutOff::Unready(_) => Some("the worker fell silent"),
        };
        self.gone(worker, cause, effects);
        effects.push(Effect::CutOff { worker, why });
    }

    /// Frees what a worker held; with a `cause`, the tiles it was rendering count as failed.
    fn gone(&mut self, worker: WorkerKey, cause: Option<&str>, effects: &mut Vec<Effect>) {
        let Some(w) = self.workers.get(&worker) else { return };
        let (leases, running) = (w.leases.clone(), w.running);
        if !leases.is_empty() {
            effects.push(Effect::Lost { worker, tiles: leases.len() as u64 });
        }
        // From the back, so that the oldest is the first to be leased again.
        for (place, lease) in leases.into_iter().enumerate().rev() {
            let Some(open) = self.close(lease) else { continue };
            match cause {
                Some(cause) if place < running => self.strike(open.tile, worker, false, cause, effects),
                _ => self.release(open.tile),
            }
        }
        self.workers.remove(&worker);
    }

    fn check_silence(&mut self, effects: &mut Vec<Effect>) {
        let (now, config) = (self.now, self.config.clone());
        let mut cut = Vec::new();
        for (&key, w) in &mut self.workers {
            let silent = now.saturating_sub(w.last_heard);
            w.suspect = silent >= config.suspect_after;
            match w.phase {
                _ if silent >= config.dead_after => cut.push((key, CutOff::Silent(silent))),
                Phase::Preparing { since } if now.saturating_sub(since) >= config.prepare_within => {
                    cut.push((key, CutOff::Unready(config.prepare_within)));
                }
                _ => {}
            }
        }
        for (worker, why) in cut {
            self.cut_off(worker, why, effects);
        }
        self.check_at = now + (config.suspect_after / 8).min(config.patience / 4);
    }

    fn check_deserted(&mut self, effects: &mut Vec<Effect>) {
        if !self.workers.is_empty() {
            self.deserted_since = None;
            return;
        }
        let since = *self.deserted_since.get_or_insert(self.now);
        let waited = self.now - since;
        if waited >= self.config.patience {
            self.end(End::NoWorkers { waited, ever: self.ever }, effects);
        }
    }

    fn end(&mut self, end: End, effects: &mut Vec<Effect>) {
        if !self.ended {
            self.ended = true;
            effects.push(Effect::End(end));
        }
    }

    fn grant(&mut self, worker: WorkerKey, id: u64, effects: &mut Vec<Effect>) {
        let (Some(tile), Some(w)) = (self.tiles.get_mut(&id), self.workers.get_mut(&worker)) else { return };
        let lease = LeaseId(self.next_lease);
        let attempt = Attempt(tile.attempts);
        self.next_lease += 1;
        tile.attempts += 1;
        tile.leases.push(lease);
        w.leases.push_back(lease);
        self.open.insert(lease, Open { worker, tile: id, attempt, granted: self.now });
        let lease = Lease { id: lease, attempt, region: tile.region, number: tile.number, pass: self.pass };
        effects.push(Effect::Grant { worker, lease });
    }
}
