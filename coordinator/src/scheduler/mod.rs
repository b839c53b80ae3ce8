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
//!     │ given back, or lost for a cause    │  │
//!     │ that is not its own                │  │ nothing is left to be cut
//!     └────────────────────────────────────┤  │
//!             failed, lost with its worker │  │
//!             alone, or long overdue       ▼  │
//!                                        wanted ─────▶ the render ends: three strikes
//! ```
//!
//! A leased tile has a lease of a worker of which an answer can be expected, and up to [`MAX_COPIES`]
//! of them: all but the first are given to workers that would otherwise be idle at the end, where the
//! holder is expected to finish later than they would. Leases that are overdue, or of workers that are silent, do
//! not count. A tile that is in doubt (`blame`) is leased after everything else, and to fewer at a time.
//!
//! # A worker's states
//!
//! ```text
//!   joined ─▶ preparing ──▶ ready ◀──▶ suspect: silent for a while   ─┐ no new leases
//!                │            │ ◀────▶ stuck: beats, and has long    ─┘
//!                │            ▼             been due to deliver
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
//! quartered (guided self-scheduling after Polychronopoulos and Kuck, 1987), less where tiles have
//! turned out to cost very unlike amounts, but no more than [`longest`](Model::longest) and no less
//! than [`shortest`](Model::shortest) of its time, both longer in a large crowd, and no more than
//! its line carries (`line`).
//! A quick worker holds several, so that it has work while answers and leases wait for a processor; what it
//! has not begun at the end goes to whoever is idle.
//!
//! # Cost
//!
//! An event touches one worker and what it holds: sums over all of them are kept up to date (`crowd`), those with
//! room are kept in order. Only what is looked at every few hundred milliseconds (silence, progress) and the end
//! of a pass walk over all workers.

mod assist;
mod blame;
mod crowd;
mod cutter;
mod grant;
mod line;
mod message;
mod model;
mod roster;
#[cfg(test)]
mod simulation;
mod size;
#[cfg(test)]
mod tests;
mod watch;
mod worker;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use tessera_core::film::Region;
use tessera_core::settings::Pass;
use tessera_proto::{Attempt, InstanceId, JobNumber, LeaseId, PassNumber};

use blame::{Loss, Strike};
use crowd::{Crowd, Preference};
use cutter::Cutter;
pub(crate) use message::{Config, CutOff, Effect, End, Event, WorkerKey};
pub use model::{MODEL, Model};
pub(crate) use worker::running;
use worker::{Delivery, Phase, Worker};

/// Leases of a tile that are not overdue, at most.
const MAX_COPIES: usize = 3;
/// Leases that one worker holds at once, at most.
const MAX_DEPTH: usize = 32;
/// Answers that a worker may owe to revoked leases.
const MAX_REVOKED: usize = 256;

/// A region that was cut and is not done.
#[derive(Debug)]
struct Tile {
    region: Region,
    number: PassNumber,
    /// Open leases, the oldest first.
    leases: Vec<LeaseId>,
    attempts: u32,
    strikes: Vec<Strike>,
    /// Losses that are not judged yet.
    doubts: usize,
    /// Until when it is let lie.
    again_at: Duration,
    /// Its place in [`Scheduler::wanted`].
    wanted: Option<Want>,
}

/// A tile's place among those wanted: the least doubtful first, and of equals the oldest.
type Want = (usize, u64);

/// A lease that is open.
#[derive(Debug)]
struct Open {
    worker: WorkerKey,
    tile: u64,
    attempt: Attempt,
    granted: Duration,
    /// [`Worker::busy`] then.
    busy_before: Duration,
}

/// See the [module](self).
#[derive(Debug)]
pub(crate) struct Scheduler {
    config: Config,
    cutter: Cutter,
    tiles: BTreeMap<u64, Tile>,
    /// Tiles of which no lease counts.
    wanted: BTreeSet<Want>,
    open: BTreeMap<LeaseId, Open>,
    workers: BTreeMap<WorkerKey, Worker>,
    instances: BTreeMap<InstanceId, WorkerKey>,
    /// Over the workers that are fit.
    crowd: Crowd,
    /// Workers that are fit and hold fewer leases than they should.
    room: BTreeSet<Preference>,
    /// Pixels a second of a thread, as far as was ever measured.
    typical: Option<f64>,
    /// Tiles in doubt.
    doubtful: BTreeSet<u64>,
    /// Workers lost of late, the oldest first.
    losses: VecDeque<Loss>,
    /// Until when lost connections are nobody's fault.
    amnesty_until: Duration,
    /// Failures, and workers lost, since the last delivery.
    failures: usize,
    losses_in_a_row: usize,
    next_tile: u64,
    next_lease: u64,
    /// The pass at hand.
    number: PassNumber,
    /// How closely it looks; `None` where sampling is uniform.
    pass: Option<Pass>,
    /// Pixels to be done in the pass at hand, as often as they are.
    pixels: u64,
    pixels_done: u64,
    tiles_done: u64,
    now: Duration,
    /// When silence and progress of workers are looked at next.
    check_at: Duration,
    /// When idle workers might take over an overdue tile, and when that was looked at last.
    assist_at: Option<Duration>,
    assisted: Duration,
    /// Since when there is no worker.
    deserted_since: Option<Duration>,
    ever: bool,
    ended: bool,
    /// Whether its owner says when a pass is complete.
    held: bool,
}

impl Scheduler {
    /// Nothing leased, nobody there, at time 0.
    pub(crate) fn new(config: Config) -> Self {
        let cutter = Cutter::new(config.region, config.tile);
        Self {
            cutter,
            tiles: BTreeMap::new(),
            wanted: BTreeSet::new(),
            open: BTreeMap::new(),
            workers: BTreeMap::new(),
            instances: BTreeMap::new(),
            crowd: Crowd::default(),
            room: BTreeSet::new(),
            typical: None,
            doubtful: BTreeSet::new(),
            losses: VecDeque::new(),
            amnesty_until: Duration::ZERO,
            failures: 0,
            losses_in_a_row: 0,
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
            assisted: Duration::ZERO,
            deserted_since: Some(Duration::ZERO),
            ever: false,
            ended: false,
            held: false,
            config,
        }
    }

    /// Goes on after [`End::Complete`] with another pass, over disjoint `regions`, in their
    /// order, or over the whole region for `None`. Pixels are expected to cost
    /// `dearer` times as much as in the pass before.
    pub(crate) fn begin(&mut self, pass: Option<Pass>, regions: Option<Vec<Region>>, dearer: f64) {
        self.ended = false;
        self.number = PassNumber(self.number.0 + 1);
        self.pass = pass;
        (self.cutter, self.pixels) = match regions {
            None => (Cutter::new(self.config.region, self.config.tile), self.config.region.area()),
            Some(regions) => {
                let pixels = regions.iter().map(Region::area).sum();
                (Cutter::of(self.config.region, regions, self.config.tile), pixels)
            }
        };
        (self.pixels_done, self.tiles_done) = (0, 0);
        let slower = |rate: Option<f64>| rate.map(|rate| rate / dearer.max(0.01));
        self.typical = slower(self.typical);
        for w in self.workers.values_mut() {
            (w.rate, w.slowest) = (slower(w.rate), slower(w.slowest));
        }
        for worker in self.workers.keys().copied().collect::<Vec<_>>() {
            self.refresh(worker);
        }
    }

    /// Begins with `pass` and over `regions` instead of as the settings say.
    pub(crate) fn begin_first(&mut self, pass: Option<Pass>, regions: Option<Vec<Region>>) {
        self.begin(pass, regions, 1.0);
        self.number = PassNumber(0);
    }

    /// Gives out leases of `job`; those of the first job are numbered so from the beginning.
    pub(crate) fn number_leases(&mut self, job: JobNumber) {
        self.next_lease = job.lease(self.next_lease).0;
    }

    /// Whether nothing is left to be cut: whoever has nothing to do will hardly get anything in this pass.
    pub(crate) fn is_running_out(&self) -> bool {
        self.cutter.pixels_left() == 0 && self.wanted.is_empty()
    }

    /// Whether somebody has room for a lease while there is something to be cut: never, once an event was handled.
    pub(crate) fn leaves_work_lying(&self) -> bool {
        self.cutter.pixels_left() > 0 && !self.room.is_empty()
    }

    /// Leaves it to its owner to say when a pass is complete: what is done may have to be done again.
    pub(crate) fn hold(&mut self) {
        self.held = true;
    }

    /// Whether every pixel of the pass at hand is done.
    pub(crate) fn is_done(&self) -> bool {
        self.pixels_done == self.pixels
    }

    /// Takes back `regions` that were done, here or before this scheduler began: they are leased again.
    pub(crate) fn redo(&mut self, regions: Vec<Region>) {
        self.tiles_done = self.tiles_done.saturating_sub(regions.len() as u64);
        for region in regions {
            self.pixels += region.area();
            self.cutter.give_back(region);
        }
    }

    /// `worker` did something that was no lease of this scheduler's, and was `busy` with it: what it holds had to wait.
    pub(crate) fn did_else(&mut self, worker: WorkerKey, busy: Duration) {
        let Some(w) = self.workers.get_mut(&worker) else { return };
        w.busy = w.busy.saturating_add(busy);
        w.last_answer = self.now;
        self.recover(worker);
    }

    /// The region of a lease that `worker` holds and that is still wanted.
    pub(crate) fn region_of(&self, worker: WorkerKey, lease: LeaseId) -> Option<Region> {
        let open = self.open.get(&lease).filter(|o| o.worker == worker)?;
        self.tiles.get(&open.tile).map(|t| t.region)
    }

    /// Whether results had better be small on their way from `worker`.
    pub(crate) fn has_narrow_line(&self, worker: WorkerKey) -> bool {
        self.workers.get(&worker).is_some_and(|w| w.line.is_narrow())
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
        self.forgive_after_a_stall(now);
        self.now = self.now.max(now);
        let about = event.worker();
        match event {
            Event::Joined { worker, threads, instance, own } => self.joined(worker, threads, instance, own),
            Event::Ready { worker } => self.ready(worker, effects),
            Event::Heard { worker } => self.heard(worker),
            Event::Done { worker, lease, attempt, busy, idle } => {
                self.heard(worker);
                self.done(worker, lease, attempt, (busy, idle), effects);
            }
            Event::Failed { worker, lease, attempt, cause } => {
                self.heard(worker);
                let tile = self.answered(worker, lease, attempt, effects);
                self.recover(worker);
                if let Some(tile) = tile {
                    self.failed(tile, worker, &cause, effects);
                }
            }
            Event::Returned { worker, lease, attempt } => {
                self.heard(worker);
                self.returned(worker, lease, attempt, effects);
            }
            Event::Draining { worker } => self.draining(worker, effects),
            Event::Broke { worker, rule } => self.cut_off(worker, CutOff::Broke(rule), effects),
            Event::Left { worker, cause } => self.gone(worker, Some(&cause), effects),
            Event::Tick => {}
        }
        if self.now >= self.check_at {
            self.check(effects);
        }
        self.check_deserted(effects);
        if !self.ended {
            self.grant_all(about, effects);
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
        w.last_answer = self.now;
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
        let mut area = 0;
        if let Some(tile) = self.tiles.get_mut(&open.tile) {
            tile.leases.retain(|l| *l != lease);
            area = tile.region.area();
        }
        if let Some(w) = self.workers.get_mut(&open.worker) {
            w.leases.retain(|l| *l != lease);
            w.held -= area;
        }
        self.refresh(open.worker);
        Some(open)
    }

    /// Takes an open lease away from its worker, which still owes an answer.
    fn revoke(&mut self, lease: LeaseId, effects: &mut Vec<Effect>) {
        let Some(open) = self.close(lease) else { return };
        let Some(w) = self.workers.get_mut(&open.worker) else { return };
        w.revoked.insert(lease);
        effects.push(Effect::Revoke { worker: open.worker, lease });
        if w.revoked.len() > MAX_REVOKED {
            self.cut_off(open.worker, CutOff::Broke("it leaves revoked leases unanswered".into()), effects);
        }
    }

    fn done(
        &mut self,
        worker: WorkerKey,
        lease: LeaseId,
        attempt: Attempt,
        (busy, idle): (Duration, Duration),
        effects: &mut Vec<Effect>,
    ) {
        let Some(w) = self.workers.get_mut(&worker) else { return };
        let was_full = w.leases.len() >= w.depth;
        w.busy = w.busy.saturating_add(busy);
        let given = self.open.get(&lease).map(|o| (o.granted, o.busy_before));
        let tile = self.answered(worker, lease, attempt, effects);
        // Late or not, it is getting on.
        self.recover(worker);
        let Some(id) = tile else { return };
        let leases = self.tiles.get(&id).map(|t| t.leases.clone()).unwrap_or_default();
        for other in leases {
            self.revoke(other, effects);
        }
        let Some(tile) = self.forget(id) else { return };
        let area = tile.region.area();
        if let (Some(w), Some((granted, busy_before))) = (self.workers.get_mut(&worker), given) {
            w.delivered(Delivery { area, busy, idle, granted, busy_before }, was_full, self.now, &self.config.model);
            self.refresh(worker);
            self.typical = self.crowd.rate_of_a_thread().or(self.typical);
        }
        (self.failures, self.losses_in_a_row) = (0, 0);
        self.pixels_done += area;
        self.tiles_done += 1;
        effects.push(Effect::Accept { worker, region: tile.region });
        if self.is_done() && !self.held {
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

    /// A tile lost a lease: without any other, and not in doubt, it is as if it had never been cut.
    fn release(&mut self, id: u64) {
        let Some(tile) = self.tiles.get(&id) else { return };
        if tile.leases.is_empty() && !tile.is_doubtful() {
            let region = tile.region;
            self.forget(id);
            self.cutter.give_back(region);
        } else {
            self.want(id);
        }
    }

    /// Forgets a tile that has no leases.
    fn forget(&mut self, id: u64) -> Option<Tile> {
        let tile = self.tiles.remove(&id)?;
        if let Some(place) = &tile.wanted {
            self.wanted.remove(place);
        }
        self.doubtful.remove(&id);
        Some(tile)
    }

    /// Keeps a tile among those wanted as long as no lease of it counts.
    fn want(&mut self, id: u64) {
        let Some(tile) = self.tiles.get_mut(&id) else { return };
        let (open, workers) = (&self.open, &self.workers);
        let is_alive = |l: &LeaseId| open.get(l).and_then(|o| workers.get(&o.worker)).is_some_and(Worker::is_alive);
        let place = (!tile.leases.iter().any(is_alive)).then_some((tile.doubt(), id));
        if tile.wanted == place {
            return;
        }
        if let Some(old) = tile.wanted.take() {
            self.wanted.remove(&old);
        }
        tile.wanted = place;
        self.wanted.extend(place);
    }

    fn end(&mut self, end: End, effects: &mut Vec<Effect>) {
        if !self.ended {
            self.ended = true;
            effects.push(Effect::End(end));
        }
    }
}
