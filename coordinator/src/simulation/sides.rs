//! What workers and the coordinator do with what they hear.

use std::time::{Duration, Instant};

use tessera_proto::LeaseId;
use tessera_proto::convert::Lease;

use super::message::{FromCoordinator, FromWorker};
use super::network::Way;
use super::world::{What, World};
use crate::scheduler::{Effect, End, Event, WorkerKey};

/// Between two looks at who was heard of, and looks between two heartbeats.
const PULSE: Duration = Duration::from_millis(100);
const LOOKS_A_BEAT: usize = 5;

impl World<'_> {
    pub(super) fn dial(&mut self, worker: usize) {
        let now = self.now;
        let w = &mut self.workers[worker];
        w.epoch += 1;
        (w.up, w.down) = (Way::new(w.quality), Way::new(w.quality));
        if w.cut_until > now {
            w.up.block(true);
            w.down.block(true);
        }
        w.starting.get_or_insert(now);
        // A connection, and its encryption.
        let (epoch, time) = (w.epoch, 4 * w.quality.delay);
        self.at(now + time, What::Connected { worker, epoch });
    }

    pub(super) fn say(&mut self, worker: usize, said: FromWorker, bytes: usize) {
        let w = &mut self.workers[worker];
        if let Some(((epoch, said), _, arrives)) = w.up.send((w.epoch, said), bytes, self.now, &mut self.rng) {
            self.at(arrives, What::ToCoordinator { worker, epoch, said, bytes });
        }
    }

    pub(super) fn worker_hears(&mut self, worker: usize, said: FromCoordinator) {
        let (now, epoch) = (self.now, self.workers[worker].epoch);
        match said {
            FromCoordinator::Welcome => {
                let w = &mut self.workers[worker];
                let most = self.setup.prepare.mul_f64(0.5 + 0.5 * self.rng.f64());
                let time = if w.prepared { Duration::ZERO } else { most };
                self.at(now + time, What::Prepared { worker, epoch });
            }
            FromCoordinator::Lease(lease) => {
                self.workers[worker].renderer.queue.push_back(lease);
                self.begin(worker);
            }
            FromCoordinator::Revoke(id) => self.revoke(worker, id),
            FromCoordinator::BeatReply => {}
            FromCoordinator::Closed => {
                let w = &mut self.workers[worker];
                w.end_session(now);
                w.starting = Some(now);
                self.dial(worker);
            }
        }
    }

    pub(super) fn prepared(&mut self, worker: usize) {
        let now = self.now;
        let w = &mut self.workers[worker];
        w.prepared = true;
        w.started(now);
        (w.renderer.last_end, w.renderer.last_sent) = (now, now);
        self.say(worker, FromWorker::Ready, 20);
    }

    /// Gives a lease back: at once where it has not begun, and within a few thousand rays where it has.
    fn revoke(&mut self, worker: usize, id: LeaseId) {
        let now = self.now;
        let w = &mut self.workers[worker];
        let returned = match w.renderer.revoke(id) {
            Some(lease) => lease,
            None => {
                let Some((lease, busy, _)) = w.renderer.finish(id, now) else { return };
                w.times.wasted += busy;
                lease
            }
        };
        self.say(worker, FromWorker::Returned { lease: id, attempt: returned.attempt }, 20);
        self.begin(worker);
    }

    pub(super) fn begin(&mut self, worker: usize) {
        let (now, picture, costs) = (self.now, self.setup.picture, &self.setup.costs);
        let cost = |l: &Lease| costs.of(&l.region, picture);
        while let Some((lease, time)) = self.workers[worker].renderer.begin(now, cost) {
            let w = &mut self.workers[worker];
            let idle = w.renderer.at_work.last().map_or(Duration::ZERO, |a| a.idle);
            let ended = self.ran_out.map_or(Duration::ZERO, |at| now.saturating_sub(at));
            w.times.waiting += idle.saturating_sub(ended);
            let epoch = w.epoch;
            self.at(now + time, What::Rendered { worker, epoch, lease });
        }
    }

    pub(super) fn rendered(&mut self, worker: usize, id: LeaseId) {
        let (now, bytes_per_pixel) = (self.now, self.setup.bytes_per_pixel);
        let w = &mut self.workers[worker];
        let Some((lease, busy, idle)) = w.renderer.finish(id, now) else { return };
        let bytes = (lease.region.area() * bytes_per_pixel) as usize + 100;
        let (attempt, shows) = (lease.attempt, lease.region);
        self.say(worker, FromWorker::Done { lease: id, attempt, shows, lies: false, busy, idle }, bytes);
        let w = &mut self.workers[worker];
        // A thread waits where the network does not take its tile.
        let (room, epoch) = (w.up.room_at(), w.epoch);
        if room > now {
            w.renderer.sending += 1;
            self.at(room, What::Taken { worker, epoch });
        } else {
            w.renderer.last_sent = now;
        }
        self.begin(worker);
    }

    /// A message is there: it is taken in when those before it are, and when the coordinator's line has carried it.
    pub(super) fn coordinator_hears(&mut self, (worker, epoch): (usize, u32), said: FromWorker, bytes: usize) {
        self.outcome.messages += 1;
        self.outcome.bytes.0 += bytes as u64;
        let service = self.setup.service;
        self.carried.0 = self.carried.0.max(self.now) + Duration::from_secs_f64(bytes as f64 / service.line);
        let begins = self.free_at.max(self.carried.0);
        self.outcome.longest_wait = self.outcome.longest_wait.max(begins - self.now);
        let mut time = service.message + Duration::from_secs_f64(bytes as f64 * service.byte_ns / 1e9);
        if service.measured {
            time += self.scheduling.div_f64(self.outcome.messages as f64);
        }
        self.free_at = begins + time;
        self.at_work += time;
        self.workers[worker].delivered = true;
        let key = self.workers[worker].key.filter(|(_, of)| *of == epoch).map(|(key, _)| key);
        match (key, said) {
            (None, FromWorker::Register) => self.admit(worker, epoch),
            (Some(worker), FromWorker::Ready) => self.tell(Event::Ready { worker }, Duration::ZERO),
            (Some(key), FromWorker::Done { lease, attempt, busy, idle, .. }) => {
                let taken = self.pixels;
                self.tell(Event::Done { worker: key, lease, attempt, busy, idle }, busy);
                if self.pixels == taken {
                    self.workers[worker].times.wasted += busy;
                }
            }
            (Some(worker), FromWorker::Returned { lease, attempt }) => {
                self.tell(Event::Returned { worker, lease, attempt }, Duration::ZERO);
            }
            (Some(key), FromWorker::Closed) => self.left(worker, key, "the connection broke"),
            (
                Some(_),
                FromWorker::Register
                | FromWorker::Failed { .. }
                | FromWorker::Garbage
                | FromWorker::Draining
                | FromWorker::Bytes
                | FromWorker::Beat,
            )
            | (None, _) => {}
        }
    }

    fn admit(&mut self, worker: usize, epoch: u32) {
        if let Some((before, _)) = self.workers[worker].key {
            self.left(worker, before, "it dialled again");
        }
        let key = WorkerKey(self.keys.len() as u64);
        self.keys.push(worker);
        self.workers[worker].key = Some((key, epoch));
        let scene = if self.workers[worker].prepared { 0 } else { self.setup.scene };
        self.answer(worker, FromCoordinator::Welcome, 200 + scene as usize);
        let w = &self.workers[worker];
        let (threads, instance) = (w.renderer.threads, w.instance);
        self.tell(Event::Joined { worker: key, threads, instance, own: false }, Duration::ZERO);
    }

    fn left(&mut self, worker: usize, key: WorkerKey, cause: &str) {
        self.workers[worker].key = None;
        self.tell(Event::Left { worker: key, cause: cause.into() }, Duration::ZERO);
    }

    /// Sends something when the coordinator has done what it is doing, and its line is free.
    pub(super) fn answer(&mut self, worker: usize, said: FromCoordinator, bytes: usize) {
        self.outcome.bytes.1 += bytes as u64;
        let mut begins = self.free_at.max(self.now);
        if matches!(said, FromCoordinator::Welcome) {
            // Scenes share the line; what is small comes through between them.
            begins = begins.max(self.carried.1);
            self.carried.1 = begins + Duration::from_secs_f64(bytes as f64 / self.setup.service.line);
        }
        let w = &mut self.workers[worker];
        // What is said to a session that is over is not heard.
        let epoch = w.key.map_or(w.epoch, |(_, epoch)| epoch);
        if let Some(((epoch, said), _, arrives)) = w.down.send((epoch, said), bytes, begins, &mut self.rng) {
            self.at(arrives, What::ToWorker { worker, epoch, said });
        }
    }

    /// Tells the scheduler, and does what it asks for. `busy`: the time that went into the tile delivered.
    fn tell(&mut self, event: Event, busy: Duration) {
        let mut effects = Vec::new();
        let now = self.free_at.max(self.now);
        let began = Instant::now();
        self.scheduler.handle(event, now, &mut effects);
        let took = began.elapsed();
        self.scheduling += took;
        self.outcome.scheduler_longest = self.outcome.scheduler_longest.max(took);
        for effect in effects {
            match effect {
                Effect::Grant { worker, lease } => {
                    self.answer(self.keys[worker.0 as usize], FromCoordinator::Lease(lease), 60)
                }
                Effect::Revoke { worker, lease } => {
                    self.answer(self.keys[worker.0 as usize], FromCoordinator::Revoke(lease), 30)
                }
                Effect::Accept { worker, region } => {
                    self.pixels += region.area();
                    self.outcome.tiles += 1;
                    let w = &mut self.workers[self.keys[worker.0 as usize]];
                    w.times.useful += busy;
                    w.last = Some(now);
                }
                Effect::CutOff { worker, .. } => {
                    let worker = self.keys[worker.0 as usize];
                    self.answer(worker, FromCoordinator::Closed, 20);
                    self.workers[worker].key = None;
                    self.outcome.cut_off += 1;
                }
                Effect::Lost { .. } => {}
                Effect::End(end) => {
                    assert_eq!(end, End::Complete);
                    self.ended = true;
                    self.now = now;
                }
            }
        }
        assert!(!self.scheduler.leaves_work_lying(), "somebody waits, and so does work");
        if self.ran_out.is_none() && self.scheduler.is_running_out() {
            self.ran_out = Some(now);
        }
        let wake = self.scheduler.wake_at().max(now);
        if wake < self.tick_at {
            self.tick_at = wake;
            self.at(wake, What::Tick);
        }
        if self.ended {
            let (width, height) = self.setup.picture;
            assert_eq!(self.pixels, u64::from(width) * u64::from(height), "complete, and it is not");
        }
    }

    pub(super) fn tick(&mut self) {
        self.tick_at = Duration::MAX;
        self.tell(Event::Tick, Duration::ZERO);
    }

    /// Tells the scheduler of whom something was heard.
    pub(super) fn check_liveness(&mut self) {
        self.last_sign += 1;
        for worker in 0..self.workers.len() {
            let w = &mut self.workers[worker];
            let Some((key, epoch)) = w.key else { continue };
            let beats = (worker + self.last_sign).is_multiple_of(LOOKS_A_BEAT);
            let alive = epoch == w.epoch && w.since.is_some() && w.cut_until <= self.now;
            if std::mem::take(&mut w.delivered) || (beats && alive) {
                self.tell(Event::Heard { worker: key }, Duration::ZERO);
            }
        }
        self.at(self.now + PULSE, What::LastSign);
    }
}
