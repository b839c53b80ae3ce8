//! Everything together, event by event.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap, VecDeque};
use std::time::Duration;

use tessera_core::film::Region;
use tessera_proto::identity::WorkerId;
use tessera_proto::{InstanceId, JobNumber, LeaseId};

use super::super::{Config, End, Event, MODEL, Scheduler, WorkerKey};
use super::faults::{self, FAULTY, Fault};
use super::picture::{Curse, Picture};
use super::session::Session;
use super::worker::SimWorker;
use crate::config::{Patience, TileSize};
use crate::farm::verify::Verify;
use crate::simulation::message::{FromCoordinator, FromWorker};
use crate::simulation::network::Quality;

pub(super) const BEAT: Duration = Duration::from_millis(500);
pub(super) const DEAD: Duration = Duration::from_secs(5);
const TICK: Duration = Duration::from_millis(1);

/// What happens at a time.
#[derive(Debug)]
pub(super) enum What {
    ToCoordinator { session: usize, said: FromWorker },
    ToWorker { session: usize, said: FromCoordinator },
    Dial { worker: usize, epoch: u64 },
    Prepared { worker: usize, epoch: u64 },
    Rendered { worker: usize, epoch: u64, lease: LeaseId },
    Taken { worker: usize, epoch: u64 },
    Leave { worker: usize, epoch: u64 },
    Beat { worker: usize, epoch: u64 },
    Start { worker: usize },
    Pass { workers: Vec<usize>, up: bool, down: bool },
    // Somebody comes only to leave, and so many more after it.
    Stranger { left: usize },
    Fault(Fault),
    Rescue,
    Tick,
}

#[derive(Debug)]
pub(super) struct World {
    seed: u64,
    pub(super) now: Duration,
    pub(super) messages: u64,
    pub(super) faults_seen: u64,
    pub(super) picture: Picture,
    pub(super) rng: fastrand::Rng,
    pub(super) scheduler: Scheduler,
    pub(super) workers: Vec<SimWorker>,
    pub(super) sessions: Vec<Session>,
    pub(super) seats: BTreeMap<WorkerKey, usize>,
    pub(super) bytes_per_pixel: u64,
    /// Passes in all, and yet to come.
    pub(super) passes: u32,
    pub(super) passes_left: u32,
    /// Tiles of the pass at hand, and when they came.
    pub(super) kept: Vec<(Duration, Region)>,
    /// Who renders what a second time, and which checks nobody was given yet.
    pub(super) verify: Verify,
    pub(super) unassigned: VecDeque<u64>,
    pub(super) thrown_out: usize,
    /// Whether the tile at hand is not what it should be.
    pub(super) lies: bool,
    /// Workers whose pixels may not be.
    pub(super) liars: BTreeSet<WorkerId>,
    pub(super) stalled_until: Duration,
    /// Ways that are cut, by worker: as many times as they are.
    pub(super) cuts: Vec<(u32, u32)>,
    pub(super) queue: BinaryHeap<Reverse<(Duration, u64)>>,
    pub(super) what: BTreeMap<u64, What>,
    pub(super) next: u64,
    pub(super) next_key: u64,
    pub(super) end: Option<End>,
    pub(super) verbose: bool,
}

impl World {
    pub(super) fn new(seed: u64, curse: Option<Curse>) -> Self {
        let mut rng = fastrand::Rng::with_seed(seed);
        let picture = Picture::new(&mut rng, curse);
        let bytes_per_pixel = [3, 12][rng.usize(0..2)];
        let tile = if rng.u32(0..4) == 0 { TileSize::Edge(rng.u32(8..40)) } else { TileSize::Auto };
        let config = Config {
            region: picture.region(),
            tile,
            samples: 1,
            expected: 0,
            bytes_per_pixel,
            patience: Patience { first: Duration::from_secs(30), lost: Duration::from_secs(300) },
            suspect_after: Duration::from_secs(2),
            dead_after: DEAD,
            prepare_within: Duration::from_secs(600),
            model: MODEL,
        };
        let count = rng.usize(1..9);
        // The whole takes between one and a few dozen seconds.
        let work = picture.cost(&picture.region()) / (1.0 + 20.0 * rng.f64());
        let passes_left = rng.u32(0..3);
        let share = if curse.is_none() && rng.u32(0..3) == 0 { [0.1, 0.5, 1.0][rng.usize(0..3)] } else { 0.0 };
        let mut world = Self {
            seed,
            now: Duration::ZERO,
            messages: 0,
            faults_seen: 0,
            picture,
            scheduler: Scheduler::new(config),
            workers: Vec::new(),
            sessions: Vec::new(),
            seats: BTreeMap::new(),
            bytes_per_pixel,
            passes: 1 + passes_left,
            passes_left,
            kept: Vec::new(),
            verify: Verify::new(share, [seed as u8; 32], JobNumber(0)),
            unassigned: VecDeque::new(),
            thrown_out: 0,
            lies: false,
            liars: BTreeSet::new(),
            stalled_until: Duration::ZERO,
            cuts: Vec::new(),
            queue: BinaryHeap::new(),
            what: BTreeMap::new(),
            next: 0,
            next_key: 0,
            end: None,
            verbose: std::env::var_os("SEED").is_some(),
            rng,
        };
        if world.verify.is_on() {
            world.scheduler.hold();
        }
        for n in 0..count {
            let speed = work / count as f64 * (0.3 + world.rng.f64());
            let quality = Quality::any(&mut world.rng);
            world.add_worker(speed, quality);
            let late = if world.rng.u32(0..4) == 0 { 10.0 * world.rng.f64() } else { 0.1 * world.rng.f64() };
            world.at(Duration::from_secs_f64(late), What::Start { worker: n });
        }
        for (at, fault) in faults::draw(&mut world.rng, count, share > 0.0) {
            world.at(at, What::Fault(fault));
        }
        world.at(Duration::from_secs_f64(FAULTY + 10.0), What::Rescue);
        world.at(Duration::ZERO, What::Tick);
        world
    }

    pub(super) fn add_worker(&mut self, speed: f64, quality: Quality) -> usize {
        let instance = InstanceId(self.rng.u64(..));
        let threads = [1, 1, 4][self.rng.usize(0..3)];
        self.workers.push(SimWorker { up: false, ..SimWorker::new(instance, threads, speed, quality) });
        self.cuts.push((0, 0));
        self.workers.len() - 1
    }

    pub(super) fn at(&mut self, time: Duration, what: What) {
        let id = self.next;
        self.next += 1;
        self.queue.push(Reverse((time.max(self.now), id)));
        self.what.insert(id, what);
    }

    /// Runs to the end of the render.
    pub(super) fn run(&mut self) -> End {
        while self.end.is_none() {
            let Some(Reverse((time, id))) = self.queue.pop() else { panic!("nothing happens any more") };
            let Some(what) = self.what.remove(&id) else { continue };
            self.now = time;
            assert!(self.now < Duration::from_secs(3000), "seed {}: there is no end", self.seed);
            self.happen(what);
            if self.end.is_none() && self.messages.is_multiple_of(64) {
                self.check();
            }
        }
        self.end.take().unwrap_or_else(|| panic!("no end"))
    }

    /// Until when it should have been done: after the last fault there is a worker that does all of it in half a
    /// minute a pass. A tile of its own may be all there is of a pass, which it then does with half its threads, and
    /// a holder that crawls is found out once it has taken twice as long as it should. What is verified is rendered
    /// twice, and what a liar made is made again.
    pub(super) fn bound(&self) -> Duration {
        let again = if self.thrown_out > 0 { 1.0 } else { 0.0 };
        let times = if self.verify.is_on() { 1.0 + self.verify.share() + again } else { 1.0 };
        Duration::from_secs_f64(FAULTY + 30.0 + 100.0 * f64::from(self.passes) * times)
    }

    fn happen(&mut self, what: What) {
        match what {
            What::ToCoordinator { session, said } => {
                if self.now < self.stalled_until {
                    return self.at(self.stalled_until, What::ToCoordinator { session, said });
                }
                self.coordinator_hears(session, said);
            }
            What::Tick if self.now < self.stalled_until => self.at(self.stalled_until, What::Tick),
            What::Tick => {
                self.unassigned.extend(self.verify.overdue(self.now, self.scheduler.is_done()));
                self.tell(Event::Tick);
                let wake = self.scheduler.wake_at().max(self.now + TICK);
                self.at(wake, What::Tick);
            }
            What::ToWorker { session, said } => {
                let worker = self.sessions[session].worker;
                if self.thawed(worker, What::ToWorker { session, said: said.clone() }) {
                    self.worker_hears(session, said);
                }
            }
            What::Dial { worker, epoch } => {
                if self.is_now(worker, epoch) && self.thawed(worker, What::Dial { worker, epoch }) {
                    self.dial(worker);
                }
            }
            What::Prepared { worker, epoch } => {
                if self.is_now(worker, epoch) && self.thawed(worker, What::Prepared { worker, epoch }) {
                    self.workers[worker].prepared = true;
                    self.say(worker, FromWorker::Ready, 20);
                }
            }
            What::Rendered { worker, epoch, lease } => {
                if self.is_now(worker, epoch) && self.unstuck(worker, What::Rendered { worker, epoch, lease }) {
                    self.rendered(worker, lease);
                }
            }
            What::Taken { worker, epoch } => {
                if self.is_now(worker, epoch) {
                    self.taken(worker);
                }
            }
            What::Leave { worker, epoch } => {
                if self.is_now(worker, epoch) {
                    self.gone(worker);
                }
            }
            What::Beat { worker, epoch } => self.beat(worker, epoch),
            What::Start { worker } => {
                let w = &mut self.workers[worker];
                if !w.up {
                    w.up = true;
                    self.dial(worker);
                }
            }
            What::Pass { workers, up, down } => self.cut(&workers, (up, down), false),
            What::Stranger { left } => self.stranger(left),
            What::Fault(fault) => self.fault(fault),
            What::Rescue => self.rescue(),
        }
    }

    pub(super) fn is_now(&self, worker: usize, epoch: u64) -> bool {
        self.workers[worker].up && self.workers[worker].epoch == epoch
    }

    /// Whether a process runs; else it does `what` when it does again.
    pub(super) fn thawed(&mut self, worker: usize, what: What) -> bool {
        let until = self.workers[worker].frozen_until;
        if until > self.now {
            self.at(until, what);
        }
        until <= self.now
    }

    fn unstuck(&mut self, worker: usize, what: What) -> bool {
        let until = self.workers[worker].stuck_until.max(self.workers[worker].frozen_until);
        if until > self.now {
            self.at(until, what);
        }
        until <= self.now
    }
}
