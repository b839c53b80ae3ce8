//! Everything together, event by event.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::time::Duration;

use tessera_core::film::Region;
use tessera_proto::{InstanceId, LeaseId};

use super::message::{FromCoordinator, FromWorker};
use super::network::Quality;
use super::renderer::Renderer;
use super::worker::SimWorker;
use super::{Outcome, Setup};
use crate::config::{Patience, TileSize};
use crate::scheduler::{Config, Scheduler};

/// Within this all workers start that do not come late.
const START: f64 = 2.0;
/// A process that is killed comes back after so long.
const AGAIN: Duration = Duration::from_secs(5);
/// Silence that ends a session, on either side.
pub(super) const DEAD: Duration = Duration::from_secs(5);

/// What happens at a time.
#[derive(Debug)]
pub(super) enum What {
    Start(usize),
    Connected { worker: usize, epoch: u32 },
    Prepared { worker: usize, epoch: u32 },
    Rendered { worker: usize, epoch: u32, lease: LeaseId },
    Taken { worker: usize, epoch: u32 },
    ToCoordinator { worker: usize, epoch: u32, said: FromWorker, bytes: usize },
    ToWorker { worker: usize, epoch: u32, said: FromCoordinator },
    Slow(usize),
    Killed { worker: usize, silent: bool },
    Cut { worker: usize, time: Duration },
    Mended(usize),
    LastSign,
    Tick,
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct World<'a> {
    pub(super) setup: &'a Setup,
    pub(super) now: Duration,
    pub(super) rng: fastrand::Rng,
    pub(super) scheduler: Scheduler,
    pub(super) workers: Vec<SimWorker>,
    /// Which worker a key is of.
    pub(super) keys: Vec<usize>,
    /// When the coordinator has done what came before, and its line has carried it.
    pub(super) free_at: Duration,
    pub(super) carried: (Duration, Duration),
    /// Time it was at work, and its scheduler really was.
    pub(super) at_work: Duration,
    pub(super) scheduling: Duration,
    pub(super) tick_at: Duration,
    pub(super) last_sign: usize,
    /// When nothing was left to be cut for the first time.
    pub(super) ran_out: Option<Duration>,
    pub(super) pixels: u64,
    pub(super) ended: bool,
    pub(super) outcome: Outcome,
    queue: BinaryHeap<Reverse<(Duration, u64, usize)>>,
    what: Vec<Option<What>>,
    free: Vec<usize>,
    next: u64,
}

impl<'a> World<'a> {
    pub(super) fn new(setup: &'a Setup) -> Self {
        let mut rng = fastrand::Rng::with_seed(setup.seed);
        let renderers = renderers(setup, &mut rng);
        let mut world = Self {
            setup,
            now: Duration::ZERO,
            scheduler: Scheduler::new(config(setup, &renderers)),
            rng,
            workers: Vec::new(),
            keys: Vec::new(),
            free_at: Duration::ZERO,
            carried: (Duration::ZERO, Duration::ZERO),
            at_work: Duration::ZERO,
            scheduling: Duration::ZERO,
            tick_at: Duration::MAX,
            last_sign: 0,
            ran_out: None,
            pixels: 0,
            ended: false,
            outcome: Outcome::default(),
            queue: BinaryHeap::new(),
            what: Vec::new(),
            free: Vec::new(),
            next: 0,
        };
        world.hire(renderers);
        world.at(Duration::ZERO, What::LastSign);
        world
    }

    /// Draws where the workers are, and what will happen to them.
    fn hire(&mut self, renderers: Vec<Renderer>) {
        let Setup { round_trip: (least, most), trouble, .. } = self.setup;
        let (least, most) = (least.as_secs_f64().max(1e-6), most.as_secs_f64().max(1e-6));
        for (worker, renderer) in renderers.into_iter().enumerate() {
            let delay = Duration::from_secs_f64(least * (most / least).powf(self.rng.f64()) / 2.0);
            let quality = Quality { delay, bytes_per_second: self.setup.line, loss: trouble.resent };
            self.workers.push(SimWorker::new(InstanceId(worker as u64), renderer, quality));
            let job = self.setup.job.as_secs_f64();
            let starts = if self.rng.f64() < trouble.late { job / 2.0 } else { START.min(job / 2.0) };
            let starts = self.rng.f64() * starts;
            self.at(Duration::from_secs_f64(starts), What::Start(worker));
            if self.rng.f64() < trouble.slow {
                self.some_time(What::Slow(worker));
            }
            if self.rng.f64() < trouble.killed {
                let silent = self.rng.bool();
                self.some_time(What::Killed { worker, silent });
            }
            if self.rng.f64() < trouble.cut {
                let time = Duration::from_secs_f64(10.0 * self.rng.f64());
                self.some_time(What::Cut { worker, time });
            }
        }
    }

    fn some_time(&mut self, what: What) {
        let time = self.setup.job.mul_f64(self.rng.f64());
        self.at(time, what);
    }

    pub(super) fn at(&mut self, time: Duration, what: What) {
        let slot = self.free.pop().unwrap_or_else(|| {
            self.what.push(None);
            self.what.len() - 1
        });
        self.what[slot] = Some(what);
        self.queue.push(Reverse((time.max(self.now), self.next, slot)));
        self.next += 1;
    }

    /// Runs to the end of the job.
    pub(super) fn run(mut self) -> Outcome {
        while !self.ended {
            let Some(Reverse((time, _, slot))) = self.queue.pop() else { panic!("nothing happens any more") };
            let Some(what) = self.what[slot].take() else { continue };
            self.free.push(slot);
            self.now = time;
            assert!(self.now < 20 * self.setup.job + Duration::from_secs(600), "there is no end");
            self.happen(what);
        }
        self.report()
    }

    fn happen(&mut self, what: What) {
        match what {
            What::Start(worker) => {
                self.workers[worker].since = Some(self.now);
                self.dial(worker);
            }
            What::Connected { worker, epoch } if self.is_now(worker, epoch) => {
                self.say(worker, FromWorker::Register, 200)
            }
            What::Prepared { worker, epoch } if self.is_now(worker, epoch) => self.prepared(worker),
            What::Rendered { worker, epoch, lease } if self.is_now(worker, epoch) => self.rendered(worker, lease),
            What::Taken { worker, epoch } if self.is_now(worker, epoch) => {
                let r = &mut self.workers[worker].renderer;
                (r.sending, r.last_sent) = (r.sending - 1, self.now);
                self.begin(worker);
            }
            What::ToWorker { worker, epoch, said } if self.is_now(worker, epoch) => self.worker_hears(worker, said),
            What::ToCoordinator { worker, epoch, said, bytes } => self.coordinator_hears((worker, epoch), said, bytes),
            What::Slow(worker) => self.workers[worker].renderer.speed /= 4.0,
            What::Killed { worker, silent } => self.killed(worker, silent),
            What::Cut { worker, time } => self.cut(worker, time),
            What::Mended(worker) => self.mended(worker),
            What::LastSign => self.check_liveness(),
            What::Tick if self.now >= self.tick_at => self.tick(),
            _ => {}
        }
    }

    fn is_now(&self, worker: usize, epoch: u32) -> bool {
        let w = &self.workers[worker];
        w.since.is_some() && w.epoch == epoch
    }

    /// A process ends, and another starts after a while.
    fn killed(&mut self, worker: usize, silent: bool) {
        if self.workers[worker].since.is_none() {
            return;
        }
        if !silent {
            self.say(worker, FromWorker::Closed, 20);
        }
        let instance = InstanceId(self.rng.u64(1 << 32..));
        let now = self.now;
        let w = &mut self.workers[worker];
        w.end_session(now);
        w.times.present += now - w.since.take().unwrap_or(now);
        (w.prepared, w.instance) = (false, instance);
        self.at(now + AGAIN, What::Start(worker));
    }

    /// Nothing passes for a while.
    fn cut(&mut self, worker: usize, time: Duration) {
        let w = &mut self.workers[worker];
        if w.since.is_none() {
            return;
        }
        w.cut_until = self.now + time;
        w.up.block(true);
        w.down.block(true);
        let gives_up = time > DEAD;
        if gives_up {
            // It gives up by itself, and dials until it comes through.
            w.end_session(self.now);
            w.starting = Some(self.now);
        }
        let epoch = w.epoch;
        self.at(self.now + time, What::Mended(worker));
        if gives_up {
            self.at(self.now + time, What::Connected { worker, epoch });
        }
    }

    fn mended(&mut self, worker: usize) {
        for ((epoch, said), bytes) in self.workers[worker].up.block(false) {
            if epoch == self.workers[worker].epoch {
                self.say(worker, said, bytes);
            }
        }
        for ((epoch, said), bytes) in self.workers[worker].down.block(false) {
            if epoch == self.workers[worker].epoch {
                self.answer(worker, said, bytes);
            }
        }
    }

    fn report(mut self) -> Outcome {
        let end = self.now;
        for w in &mut self.workers {
            if let Some(since) = w.since {
                w.times.present += end - since.min(end);
            }
            w.started(end);
        }
        let ends: Vec<Duration> = self.workers.iter().filter(|s| s.since.is_some()).filter_map(|s| s.last).collect();
        self.outcome.mean_end = ends.iter().sum::<Duration>() / (ends.len() as u32).max(1);
        self.outcome.took = ends.iter().copied().max().unwrap_or(end);
        self.outcome.load = self.at_work.as_secs_f64() / end.as_secs_f64();
        self.outcome.scheduler = self.scheduling.div_f64(self.outcome.tiles.max(1) as f64);
        let times: Vec<_> = self.workers.iter().map(|s| s.times).collect();
        self.outcome.share_out(times.into_iter());
        self.outcome
    }
}

/// What the farm's driver tells the scheduler.
fn config(setup: &Setup, renderers: &[Renderer]) -> Config {
    let (width, height) = setup.picture;
    let threads: u32 = renderers.iter().map(|r| r.threads).sum();
    let speed: f64 = renderers.iter().map(|r| r.speed).sum();
    let samples = f64::from(threads) / speed / setup.sample.as_secs_f64();
    Config {
        region: Region { x0: 0, y0: 0, x1: width, y1: height },
        tile: TileSize::Auto,
        // Saturates.
        samples: (samples as u32).max(1),
        expected: 0,
        bytes_per_pixel: setup.bytes_per_pixel,
        patience: Patience { first: Duration::from_secs(30), lost: Duration::from_secs(300) },
        suspect_after: Duration::from_secs(2),
        dead_after: DEAD,
        prepare_within: Duration::from_secs(600),
        model: setup.model,
    }
}

/// Draws what renders, so fast that all together take the job's time for the picture.
fn renderers(setup: &Setup, rng: &mut fastrand::Rng) -> Vec<Renderer> {
    let drawn: Vec<(u32, f64)> = (0..setup.workers.max(1))
        .map(|_| {
            let threads = rng.choice(&setup.threads).copied().unwrap_or(1);
            (threads, f64::from(threads) * setup.unlike.powf(rng.f64() - 0.5))
        })
        .collect();
    let (width, height) = setup.picture;
    let all = f64::from(width) * f64::from(height) / setup.job.as_secs_f64();
    let one = all / drawn.iter().map(|(_, speed)| speed).sum::<f64>();
    drawn.into_iter().map(|(threads, speed)| Renderer::new(threads, one * speed)).collect()
}
