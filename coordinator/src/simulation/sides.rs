//! What workers and the coordinator do with what they hear.

use std::time::{Duration, Instant};

use tessera_proto::LeaseId;
use tessera_proto::convert::Lease;

use super::network::Way;
use super::seat::{Down, Up};
use super::world::{What, World};
use crate::scheduler::{Effect, End, Event, WorkerKey};

/// Between two looks at who was heard of, and looks between two heartbeats.
const PULSE: Duration = Duration::from_millis(100);
const LOOKS_A_BEAT: usize = 5;

impl World<'_> {
    pub(super) fn dial(&mut self, worker: usize) {
        let now = self.now;
        let seat = &mut self.seats[worker];
        seat.epoch += 1;
        (seat.up, seat.down) = (Way::new(seat.quality), Way::new(seat.quality));
        if seat.cut_until > now {
            seat.up.block(true);
            seat.down.block(true);
        }
        seat.starting.get_or_insert(now);
        // A connection, and its encryption.
        let (epoch, time) = (seat.epoch, 4 * seat.quality.delay);
        self.at(now + time, What::Connected { worker, epoch });
    }

    pub(super) fn say(&mut self, worker: usize, said: Up, bytes: usize) {
        let seat = &mut self.seats[worker];
        if let Some(((epoch, said), _, arrives)) = seat.up.send((seat.epoch, said), bytes, self.now, &mut self.rng) {
            self.at(arrives, What::ToCoordinator { worker, epoch, said, bytes });
        }
    }

    pub(super) fn worker_hears(&mut self, worker: usize, said: Down) {
        let (now, epoch) = (self.now, self.seats[worker].epoch);
        match said {
            Down::Welcome => {
                let seat = &mut self.seats[worker];
                let most = self.setup.prepare.mul_f64(0.5 + 0.5 * self.rng.f64());
                let time = if seat.prepared { Duration::ZERO } else { most };
                self.at(now + time, What::Prepared { worker, epoch });
            }
            Down::Lease(lease) => {
                self.seats[worker].renderer.queue.push_back(lease);
                self.begin(worker);
            }
            Down::Revoke(id) => self.revoke(worker, id),
            Down::Closed => {
                let seat = &mut self.seats[worker];
                seat.end_session(now);
                seat.starting = Some(now);
                self.dial(worker);
            }
        }
    }

    pub(super) fn prepared(&mut self, worker: usize) {
        let now = self.now;
        let seat = &mut self.seats[worker];
        seat.prepared = true;
        seat.started(now);
        (seat.renderer.last_end, seat.renderer.last_sent) = (now, now);
        self.say(worker, Up::Ready, 20);
    }

    /// Gives a lease back: at once where it has not begun, and within a few thousand rays where it has.
    fn revoke(&mut self, worker: usize, id: LeaseId) {
        let now = self.now;
        let seat = &mut self.seats[worker];
        let returned = match seat.renderer.revoke(id) {
            Some(lease) => lease,
            None => {
                let Some((lease, busy, _)) = seat.renderer.finish(id, now) else { return };
                seat.times.wasted += busy;
                lease
            }
        };
        self.say(worker, Up::Returned { lease: id, attempt: returned.attempt }, 20);
        self.begin(worker);
    }

    pub(super) fn begin(&mut self, worker: usize) {
        let (now, picture, costs) = (self.now, self.setup.picture, &self.setup.costs);
        let cost = |l: &Lease| costs.of(&l.region, picture);
        while let Some((lease, time)) = self.seats[worker].renderer.begin(now, cost) {
            let seat = &mut self.seats[worker];
            let idle = seat.renderer.at_work.last().map_or(Duration::ZERO, |a| a.idle);
            let ended = self.ran_out.map_or(Duration::ZERO, |at| now.saturating_sub(at));
            seat.times.waiting += idle.saturating_sub(ended);
            let epoch = seat.epoch;
            self.at(now + time, What::Rendered { worker, epoch, lease });
        }
    }

    pub(super) fn rendered(&mut self, worker: usize, id: LeaseId) {
        let (now, bytes_per_pixel) = (self.now, self.setup.bytes_per_pixel);
        let seat = &mut self.seats[worker];
        let Some((lease, busy, idle)) = seat.renderer.finish(id, now) else { return };
        let bytes = (lease.region.area() * bytes_per_pixel) as usize + 100;
        self.say(worker, Up::Done { lease: id, attempt: lease.attempt, busy, idle }, bytes);
        let seat = &mut self.seats[worker];
        // A thread waits where the network does not take its tile.
        let (room, epoch) = (seat.up.room_at(), seat.epoch);
        if room > now {
            seat.renderer.sending += 1;
            self.at(room, What::Taken { worker, epoch });
        } else {
            seat.renderer.last_sent = now;
        }
        self.begin(worker);
    }

    /// A message is there: it is taken in when those before it are, and when the coordinator's line has carried it.
    pub(super) fn coordinator_hears(&mut self, (worker, epoch): (usize, u32), said: Up, bytes: usize) {
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
        self.seats[worker].delivered = true;
        let key = self.seats[worker].key.filter(|(_, of)| *of == epoch).map(|(key, _)| key);
        match (key, said) {
            (None, Up::Register) => self.admit(worker, epoch),
            (Some(worker), Up::Ready) => self.tell(Event::Ready { worker }, Duration::ZERO),
            (Some(key), Up::Done { lease, attempt, busy, idle }) => {
                let taken = self.pixels;
                self.tell(Event::Done { worker: key, lease, attempt, busy, idle }, busy);
                if self.pixels == taken {
                    self.seats[worker].times.wasted += busy;
                }
            }
            (Some(worker), Up::Returned { lease, attempt }) => {
                self.tell(Event::Returned { worker, lease, attempt }, Duration::ZERO);
            }
            (Some(key), Up::Closed) => self.left(worker, key, "the connection broke"),
            (Some(_), Up::Register) | (None, _) => {}
        }
    }

    fn admit(&mut self, worker: usize, epoch: u32) {
        if let Some((before, _)) = self.seats[worker].key {
            self.left(worker, before, "it dialled again");
        }
        let key = WorkerKey(self.keys.len() as u64);
        self.keys.push(worker);
        self.seats[worker].key = Some((key, epoch));
        let scene = if self.seats[worker].prepared { 0 } else { self.setup.scene };
        self.answer(worker, Down::Welcome, 200 + scene as usize);
        let seat = &self.seats[worker];
        let (threads, instance) = (seat.renderer.threads, seat.instance);
        self.tell(Event::Joined { worker: key, threads, instance, own: false }, Duration::ZERO);
    }

    fn left(&mut self, worker: usize, key: WorkerKey, cause: &str) {
        self.seats[worker].key = None;
        self.tell(Event::Left { worker: key, cause: cause.into() }, Duration::ZERO);
    }

    /// Sends something when the coordinator has done what it is doing, and its line is free.
    pub(super) fn answer(&mut self, worker: usize, said: Down, bytes: usize) {
        self.outcome.bytes.1 += bytes as u64;
        let mut begins = self.free_at.max(self.now);
        if matches!(said, Down::Welcome) {
            // Scenes share the line; what is small comes through between them.
            begins = begins.max(self.carried.1);
            self.carried.1 = begins + Duration::from_secs_f64(bytes as f64 / self.setup.service.line);
        }
        let seat = &mut self.seats[worker];
        // What is said to a session that is over is not heard.
        let epoch = seat.key.map_or(seat.epoch, |(_, epoch)| epoch);
        if let Some(((epoch, said), _, arrives)) = seat.down.send((epoch, said), bytes, begins, &mut self.rng) {
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
                Effect::Grant { worker, lease } => self.answer(self.keys[worker.0 as usize], Down::Lease(lease), 60),
                Effect::Revoke { worker, lease } => self.answer(self.keys[worker.0 as usize], Down::Revoke(lease), 30),
                Effect::Accept { worker, region } => {
                    self.pixels += region.area();
                    self.outcome.tiles += 1;
                    let seat = &mut self.seats[self.keys[worker.0 as usize]];
                    seat.times.useful += busy;
                    seat.last = Some(now);
                }
                Effect::CutOff { worker, .. } => {
                    let worker = self.keys[worker.0 as usize];
                    self.answer(worker, Down::Closed, 20);
                    self.seats[worker].key = None;
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
        for worker in 0..self.seats.len() {
            let seat = &mut self.seats[worker];
            let Some((key, epoch)) = seat.key else { continue };
            let beats = (worker + self.last_sign).is_multiple_of(LOOKS_A_BEAT);
            let alive = epoch == seat.epoch && seat.since.is_some() && seat.cut_until <= self.now;
            if std::mem::take(&mut seat.delivered) || (beats && alive) {
                self.tell(Event::Heard { worker: key }, Duration::ZERO);
            }
        }
        self.at(self.now + PULSE, What::LastSign);
    }
}
