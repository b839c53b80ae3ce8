//! The coordinator's side: what the farm's driver does.

use std::time::Duration;

use tessera_core::film::Region;
use tessera_proto::LeaseId;

use super::super::{Effect, End, Event, MAX_DEPTH, MAX_REVOKED, Scheduler, WorkerKey};
use super::world::{What, World};
use crate::config::TileSize;
use crate::farm::verify::Verify;
use crate::journal::rest;
use crate::simulation::message::{FromCoordinator, FromWorker};

/// What came within this time may not be on the disk.
const UNSYNCED: Duration = Duration::from_secs(1);

impl World {
    pub(super) fn coordinator_hears(&mut self, session: usize, said: FromWorker) {
        self.messages += 1;
        if self.sessions[session].closed_there {
            return;
        }
        let Some(worker) = self.sessions[session].key else {
            if matches!(said, FromWorker::Register) {
                self.admit(session);
            }
            return;
        };
        match said {
            FromWorker::Register => self.tell(Event::Broke { worker, rule: "it registered twice".into() }),
            FromWorker::Ready => {
                self.sessions[session].ready = true;
                self.tell(Event::Ready { worker });
            }
            FromWorker::Bytes => self.tell(Event::Heard { worker }),
            FromWorker::Beat => {
                self.tell(Event::Heard { worker });
                self.answer(session, FromCoordinator::BeatReply, 60);
            }
            FromWorker::Garbage => self.tell(Event::Broke { worker, rule: "a tile of the wrong size".into() }),
            FromWorker::Draining => {
                self.sessions[session].ready = false;
                self.tell(Event::Draining { worker });
            }
            FromWorker::Closed => self.left(worker, "the connection broke"),
            FromWorker::Done { lease, shows, lies, busy, .. } if Verify::is_check(lease) => {
                self.check_answered(worker, lease, (shows, lies), busy);
            }
            FromWorker::Failed { lease, .. } | FromWorker::Returned { lease, .. } if Verify::is_check(lease) => {
                self.check_failed(worker, lease);
            }
            FromWorker::Done { lease, attempt, shows, lies, busy, idle } => {
                if let Some(region) = self.scheduler.region_of(worker, lease)
                    && self.sessions[session].owed.contains(&lease)
                {
                    assert_eq!(region, shows, "a tile in the wrong place");
                }
                self.sessions[session].owed.remove(&lease);
                self.lies = lies;
                self.tell(Event::Done { worker, lease, attempt, busy, idle });
            }
            FromWorker::Failed { lease, attempt } => {
                self.sessions[session].owed.remove(&lease);
                self.tell(Event::Failed { worker, lease, attempt, cause: "cursed".into() });
            }
            FromWorker::Returned { lease, attempt } => {
                self.sessions[session].owed.remove(&lease);
                self.tell(Event::Returned { worker, lease, attempt });
            }
        }
    }

    fn admit(&mut self, session: usize) {
        let number = self.sessions[session].worker;
        let (instance, threads) = (self.workers[number].instance, self.workers[number].renderer.threads);
        let before = self.seats.iter().find(|(_, s)| self.workers[self.sessions[**s].worker].instance == instance);
        if let Some(before) = before.map(|(key, _)| *key) {
            self.left(before, "it dialled again");
        }
        let worker = WorkerKey(self.next_key);
        self.next_key += 1;
        self.sessions[session].key = Some(worker);
        self.seats.insert(worker, session);
        self.answer(session, FromCoordinator::Welcome, 200);
        self.tell(Event::Joined { worker, threads, instance, own: false });
    }

    fn left(&mut self, worker: WorkerKey, cause: &str) {
        self.tell(Event::Left { worker, cause: cause.into() });
        self.unseat(worker);
    }

    fn unseat(&mut self, worker: WorkerKey) {
        let Some(session) = self.seats.remove(&worker) else { return };
        let id = self.sessions[session].id;
        self.unassigned.extend(self.verify.left(worker, id));
        self.answer(session, FromCoordinator::Closed, 20);
        let s = &mut self.sessions[session];
        (s.closed_there, s.key) = (true, None);
        s.owed.clear();
    }

    pub(super) fn tell(&mut self, event: Event) {
        if self.end.is_some() {
            return;
        }
        let mut effects = Vec::new();
        if self.verbose && !matches!(event, Event::Tick | Event::Heard { .. }) {
            println!("{:9.3} {event:?}", self.now.as_secs_f64());
        }
        self.scheduler.handle(event, self.now, &mut effects);
        let mut complete = false;
        for effect in effects {
            if self.verbose {
                println!("{:9.3}     {effect:?}", self.now.as_secs_f64());
            }
            match effect {
                Effect::Grant { worker, lease } => {
                    let session = self.seats[&worker];
                    self.sessions[session].owed.insert(lease.id);
                    self.answer(session, FromCoordinator::Lease(lease), 60);
                }
                Effect::Revoke { worker, lease } => {
                    let session = self.seats[&worker];
                    assert!(self.sessions[session].owed.contains(&lease), "it was answered before");
                    self.answer(session, FromCoordinator::Revoke(lease), 30);
                }
                Effect::Accept { worker, region } => self.accepted(worker, region),
                Effect::CutOff { worker, .. } => self.unseat(worker),
                Effect::Lost { .. } => {}
                Effect::End(End::Complete) => complete = true,
                Effect::End(end) => self.end = Some(end),
            }
        }
        if self.end.is_none() {
            self.assign();
        }
        let verified = self.verify.is_on() && !self.verify.is_waiting() && self.scheduler.is_done();
        if complete || (verified && self.end.is_none()) {
            self.passed();
        }
    }

    fn passed(&mut self) {
        assert!(self.picture.is_whole(), "complete, and it is not");
        assert!(self.verify.share() < 1.0 || self.picture.is_true(), "a lie is left");
        self.verify.next_pass(true);
        if self.passes_left == 0 {
            self.end = Some(End::Complete);
            return;
        }
        self.passes_left -= 1;
        self.picture.clear();
        self.kept.clear();
        let dearer = 0.5 + self.rng.f64();
        self.scheduler.begin(None, None, dearer);
        self.tell(Event::Tick);
    }

    pub(super) fn answer(&mut self, session: usize, said: FromCoordinator, bytes: usize) {
        let s = &mut self.sessions[session];
        if s.closed_there {
            return;
        }
        if let Some((said, _, arrives)) = s.down.send(said, bytes, self.now, &mut self.rng) {
            self.at(arrives, What::ToWorker { session, said });
        }
    }

    /// The process ends: all connections with it, and what came last. Another one goes on from what is on the disk.
    pub(super) fn crash(&mut self, time: Duration) {
        for session in 0..self.sessions.len() {
            self.answer(session, FromCoordinator::Closed, 20);
            let s = &mut self.sessions[session];
            (s.closed_there, s.key) = (true, None);
            s.owed.clear();
        }
        self.seats.clear();
        self.stalled_until = self.stalled_until.max(self.now + time);
        let synced = self.now.saturating_sub(UNSYNCED);
        for (_, region) in self.kept.extract_if(.., |(at, _)| *at > synced).collect::<Vec<_>>() {
            self.picture.take(&region);
        }
        let done: Vec<Region> = self.kept.iter().map(|(_, region)| *region).collect();
        let edge = match self.scheduler.config.tile {
            TileSize::Edge(edge) => edge,
            TileSize::Auto => TileSize::MAX_EDGE,
        };
        let left = rest(&self.picture.region().blocks(edge), &done).expect("tiles of the picture, each once");
        self.scheduler = Scheduler::new(self.scheduler.config.clone());
        self.scheduler.begin_first(None, Some(left));
        self.scheduler.deserted_since = Some(self.stalled_until);
    }

    /// No lease is forgotten by one side alone, and nothing grows.
    pub(super) fn check(&self) {
        let s = &self.scheduler;
        for (lease, open) in &s.open {
            let session = self.seats.get(&open.worker).expect("a lease of somebody who is gone");
            assert!(self.sessions[*session].owed.contains(lease), "lease {lease} was answered and is open");
            assert!(s.tiles[&open.tile].leases.contains(lease));
        }
        for (key, w) in &s.workers {
            let owed = &self.sessions[self.seats[key]].owed;
            let known = |l: &LeaseId| Verify::is_check(*l) || s.open.contains_key(l) || w.revoked.contains(l);
            assert!(owed.iter().all(known), "a lease is forgotten");
            assert!(w.leases.len() <= MAX_DEPTH && w.revoked.len() <= MAX_REVOKED);
        }
        assert!(s.tiles.len() <= s.open.len() + s.wanted.len(), "tiles leak");
        assert!(s.losses.len() <= 200 && s.cutter.spares() <= 4000, "memory grows");
        assert_eq!(s.crowd.count, s.workers.values().filter(|w| w.is_fit()).count());
    }
}
