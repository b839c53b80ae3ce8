//! Tiles rendered twice: what the farm's driver does for it.

use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region};
use tessera_proto::identity::WorkerId;
use tessera_proto::{InstanceId, LeaseId};

use super::super::{Event, WorkerKey};
use super::world::World;
use crate::farm::verify::{Assigned, Closed, Made, Sum, sum_of};
use crate::simulation::message::FromCoordinator;

/// The sum of a region's pixels, as they are or not.
fn sum(r: &Region, lies: bool) -> Sum {
    let place = [r.x0, r.y0, r.x1, r.y1].map(u32::to_le_bytes);
    let mut pixels = place.as_flattened().to_vec();
    pixels.push(u8::from(lies));
    sum_of(&pixels, &ErrorEstimate::default())
}

/// The key of a process.
pub(super) fn id_of(instance: InstanceId) -> WorkerId {
    let mut id = [0; 32];
    id[..8].copy_from_slice(&instance.0.to_le_bytes());
    WorkerId(id)
}

impl World {
    pub(super) fn accepted(&mut self, worker: WorkerKey, region: Region) {
        self.picture.put(&region, self.lies);
        self.kept.push((self.now, region));
        if self.verify.is_on() {
            let maker = self.sessions[self.seats[&worker]].id;
            let made = Made { region, maker, error: ErrorEstimate::default(), verified: false };
            let sum = sum(&region, self.lies);
            self.unassigned.extend(self.verify.accepted((made, sum), None, Duration::ZERO));
        }
    }

    pub(super) fn assign(&mut self) {
        while let Some(&check) = self.unassigned.front() {
            let ready = self.seats.iter().filter(|(_, s)| self.sessions[**s].ready);
            let ready: Vec<_> = ready.map(|(&key, &session)| (key, self.sessions[session].id)).collect();
            match self.verify.assign(check, &ready, !ready.is_empty(), self.now) {
                Some(Assigned::To(worker, lease)) => {
                    let session = self.seats[&worker];
                    self.sessions[session].owed.insert(lease.id);
                    self.answer(session, FromCoordinator::Lease(lease), 60);
                }
                Some(Assigned::Here { check, region, .. }) => {
                    self.unassigned.pop_front();
                    let closed = self.verify.decided(check, Some(sum(&region, false)));
                    if let Some(closed) = closed {
                        self.closed(closed);
                    }
                    continue;
                }
                Some(Assigned::Later) => return,
                None => {}
            }
            self.unassigned.pop_front();
        }
    }

    pub(super) fn check_failed(&mut self, worker: WorkerKey, lease: LeaseId) {
        let session = self.seats[&worker];
        self.sessions[session].owed.remove(&lease);
        if self.verify.region_of(worker, lease).is_some() {
            self.verify.failed(lease, self.sessions[session].id);
            self.unassigned.push_back(lease.0);
            self.assign();
        }
    }

    pub(super) fn check_answered(
        &mut self,
        worker: WorkerKey,
        lease: LeaseId,
        (shows, lies): (Region, bool),
        busy: Duration,
    ) {
        let session = self.seats[&worker];
        self.sessions[session].owed.remove(&lease);
        if self.verify.region_of(worker, lease).is_none() {
            return;
        }
        self.tell(Event::Heard { worker });
        self.scheduler.did_else(worker, busy);
        match self.verify.answered(lease, self.sessions[session].id, sum(&shows, lies)) {
            Some(closed) => self.closed(closed),
            None => self.unassigned.push_front(lease.0),
        }
        self.tell(Event::Tick);
    }

    fn closed(&mut self, closed: Closed) {
        for liar in closed.liars {
            assert!(self.liars.contains(&liar), "an honest worker was thrown out");
            let (now, _) = self.verify.take_back(liar);
            let regions: Vec<Region> = now.iter().map(|made| made.region).collect();
            regions.iter().for_each(|region| self.picture.take(region));
            self.scheduler.redo(regions);
            self.thrown_out += 1;
            let seated = self.seats.iter().find(|(_, s)| self.sessions[**s].id == liar).map(|(&worker, _)| worker);
            if let Some(worker) = seated {
                self.tell(Event::Broke { worker, rule: "it lied".into() });
            }
        }
    }
}
