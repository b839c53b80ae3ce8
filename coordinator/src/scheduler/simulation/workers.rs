//! The workers' side: what a worker's session does.

use std::time::Duration;

use tessera_proto::convert::Lease;
use tessera_proto::{Attempt, InstanceId, LeaseId};

use super::faults::Lie;
use super::picture::Curse;
use super::session::Session;
use super::verification::id_of;
use super::worker::SimWorker;
use super::world::{BEAT, DEAD, What, World};
use crate::simulation::message::{FromCoordinator, FromWorker};

impl World {
    pub(super) fn dial(&mut self, worker: usize) {
        let w = &mut self.workers[worker];
        w.epoch += 1;
        let (epoch, quality) = (w.epoch, w.quality);
        w.draining = false;
        let (up, down) = self.cuts[worker];
        if up > 0 || down > 0 {
            // No connection comes about.
            let wait = DEAD + self.workers[worker].next_wait(&mut self.rng);
            return self.at(self.now + wait, What::Dial { worker, epoch });
        }
        let session = self.sessions.len();
        self.sessions.push(Session::new(worker, id_of(self.workers[worker].instance), quality));
        let w = &mut self.workers[worker];
        w.session = Some(session);
        w.last_reply = self.now;
        w.renderer.last_end = self.now;
        self.say(worker, FromWorker::Register, 200);
        self.at(self.now + 2 * DEAD, What::Beat { worker, epoch });
    }

    pub(super) fn say(&mut self, worker: usize, said: FromWorker, bytes: usize) {
        let Some(session) = self.workers[worker].session else { return };
        let s = &mut self.sessions[session];
        let sent = s.up.send(said, bytes, self.now, &mut self.rng);
        self.arrive(session, sent);
    }

    pub(super) fn arrive(&mut self, session: usize, sent: Option<(FromWorker, Duration, Duration)>) {
        let Some((said, mut begins, arrives)) = sent else { return };
        // Bytes of a long message are heard one after another.
        while begins + BEAT < arrives {
            begins += BEAT;
            self.at(begins, What::ToCoordinator { session, said: FromWorker::Bytes });
        }
        self.at(arrives, What::ToCoordinator { session, said });
    }

    pub(super) fn worker_hears(&mut self, session: usize, said: FromCoordinator) {
        let worker = self.sessions[session].worker;
        if self.workers[worker].session != Some(session) || self.sessions[session].closed_here {
            return;
        }
        let epoch = self.workers[worker].epoch;
        match said {
            FromCoordinator::Welcome => {
                let w = &mut self.workers[worker];
                w.wait = Duration::from_millis(200);
                let time = if w.prepared { 0.001 } else { 0.05 + self.rng.f64() };
                self.at(self.now + Duration::from_secs_f64(time), What::Prepared { worker, epoch });
                self.workers[worker].last_reply = self.now;
                self.at(self.now, What::Beat { worker, epoch });
            }
            FromCoordinator::Lease(lease) if self.workers[worker].draining => self.give_back(worker, &lease),
            FromCoordinator::Lease(lease) => {
                self.workers[worker].renderer.queue.push_back(lease);
                self.begin(worker);
            }
            FromCoordinator::Revoke(id) => {
                if let Some(lease) = self.workers[worker].renderer.revoke(id) {
                    self.give_back(worker, &lease);
                }
            }
            FromCoordinator::BeatReply => self.workers[worker].last_reply = self.now,
            FromCoordinator::Closed => self.lost(worker),
        }
    }

    fn give_back(&mut self, worker: usize, lease: &Lease) {
        self.say(worker, FromWorker::Returned { lease: lease.id, attempt: lease.attempt }, 20);
    }

    pub(super) fn begin(&mut self, worker: usize) {
        let now = self.now;
        while let Some((lease, time)) = self.workers[worker].renderer.begin(now, |l| self.picture.cost(&l.region)) {
            let epoch = self.workers[worker].epoch;
            self.at(now + time, What::Rendered { worker, epoch, lease });
        }
    }

    pub(super) fn rendered(&mut self, worker: usize, id: LeaseId) {
        let Some((lease, busy, idle)) = self.workers[worker].renderer.finish(id, self.now) else { return };
        let (attempt, shows) = (lease.attempt, lease.region);
        match self.picture.curse(&shows) {
            Some(Curse::Kills) => return self.kill(worker, Some(Duration::from_secs(1))),
            Some(Curse::Fails) => self.say(worker, FromWorker::Failed { lease: id, attempt }, 40),
            None => {
                let bytes = shows.area() as usize * self.bytes_per_pixel as usize + 100;
                let lies = matches!(self.workers[worker].lie, Some(Lie::Pixels)) && self.rng.u32(0..4) == 0;
                let done = |lease, attempt| FromWorker::Done { lease, attempt, shows, lies, busy, idle };
                match self.workers[worker].lie {
                    Some(Lie::Forged) => self.say(worker, done(LeaseId(id.0 + 1_000_000), attempt), bytes),
                    Some(Lie::Attempt) => self.say(worker, done(id, Attempt(attempt.0 + 1)), bytes),
                    Some(Lie::Garbage) => self.say(worker, FromWorker::Garbage, bytes),
                    lie => {
                        self.say(worker, done(id, attempt), bytes);
                        if matches!(lie, Some(Lie::Twice)) {
                            self.say(worker, done(id, attempt), bytes);
                        }
                    }
                }
            }
        }
        let epoch = self.workers[worker].epoch;
        let Some(session) = self.workers[worker].session else { return };
        // A thread waits where the network does not take its tile.
        let room = self.sessions[session].up.room_at();
        self.workers[worker].renderer.sending += 1;
        self.at(room, What::Taken { worker, epoch });
        if self.workers[worker].draining && self.workers[worker].renderer.at_work.is_empty() {
            self.leave(worker);
        }
    }

    pub(super) fn taken(&mut self, worker: usize) {
        let r = &mut self.workers[worker].renderer;
        (r.sending, r.last_sent) = (r.sending - 1, self.now);
        self.begin(worker);
    }

    /// Beats, and gives up on a coordinator that does not answer.
    pub(super) fn beat(&mut self, worker: usize, epoch: u64) {
        if !self.is_now(worker, epoch) || !self.thawed(worker, What::Beat { worker, epoch }) {
            return;
        }
        let Some(session) = self.workers[worker].session else { return };
        if self.now > self.workers[worker].last_reply + DEAD {
            return self.lost(worker);
        }
        let s = &mut self.sessions[session];
        // It has not been welcomed yet: only its patience is at stake.
        if let Some((said, _, arrives)) = s.beats.send(FromWorker::Beat, 60, self.now, &mut self.rng) {
            self.at(arrives, What::ToCoordinator { session, said });
        }
        self.at(self.now + BEAT, What::Beat { worker, epoch });
    }

    /// The connection is gone: it dials again.
    pub(super) fn lost(&mut self, worker: usize) {
        self.close(worker);
        if self.workers[worker].lie.is_some() {
            // It was thrown out, and takes that for an answer.
            self.workers[worker].up = false;
            return;
        }
        let wait = self.workers[worker].next_wait(&mut self.rng);
        let epoch = self.workers[worker].epoch;
        self.at(self.now + wait, What::Dial { worker, epoch });
    }

    /// Closes its end of the connection, of which the coordinator hears when something passes.
    fn close(&mut self, worker: usize) {
        if let Some(session) = self.workers[worker].session {
            self.say(worker, FromWorker::Closed, 20);
            self.sessions[session].closed_here = true;
        }
        self.workers[worker].end_session();
    }

    /// Ends a process at once; another starts after a while.
    pub(super) fn kill(&mut self, worker: usize, again: Option<Duration>) {
        if !self.workers[worker].up {
            return;
        }
        self.close(worker);
        let (threads, speed, quality) = {
            let w = &self.workers[worker];
            (w.renderer.threads, w.renderer.speed, w.quality)
        };
        let (epoch, instance) = (self.workers[worker].epoch, InstanceId(self.rng.u64(..)));
        self.workers[worker] =
            SimWorker { up: false, epoch: epoch + 1, ..SimWorker::new(instance, threads, speed, quality) };
        if let Some(again) = again {
            self.at(self.now + again, What::Start { worker });
        }
    }

    /// Told to leave: it returns what it has not begun, and goes when the rest is done.
    pub(super) fn drain(&mut self, worker: usize) {
        if self.workers[worker].session.is_none() || self.workers[worker].draining {
            return;
        }
        self.workers[worker].draining = true;
        self.say(worker, FromWorker::Draining, 20);
        for lease in std::mem::take(&mut self.workers[worker].renderer.queue) {
            self.give_back(worker, &lease);
        }
        if self.workers[worker].renderer.at_work.is_empty() {
            self.leave(worker);
        }
    }

    /// Ends its half in peace, after what may still come is returned.
    fn leave(&mut self, worker: usize) {
        let epoch = self.workers[worker].epoch;
        self.at(self.now + Duration::from_millis(500), What::Leave { worker, epoch });
    }

    pub(super) fn gone(&mut self, worker: usize) {
        self.kill(worker, None);
    }
}
