//! A connection of a worker, as both ends see it, and what is said over it.

use std::collections::BTreeSet;

use tessera_proto::LeaseId;
use tessera_proto::identity::WorkerId;

use super::super::WorkerKey;
use crate::simulation::message::{FromCoordinator, FromWorker};
use crate::simulation::network::{Quality, Way};

#[derive(Debug)]
pub(super) struct Session {
    pub(super) worker: usize,
    /// Which worker that was then: one that is killed comes back as another.
    pub(super) id: WorkerId,
    /// As the coordinator knows it, from registration until it is gone.
    pub(super) key: Option<WorkerKey>,
    pub(super) up: Way<FromWorker>,
    pub(super) down: Way<FromCoordinator>,
    /// Beats have a connection of their own.
    pub(super) beats: Way<FromWorker>,
    /// Whether it is ready, as far as the coordinator knows.
    pub(super) ready: bool,
    /// Leases that the coordinator gave and has no answer to.
    pub(super) owed: BTreeSet<LeaseId>,
    /// Whether the ends are closed.
    pub(super) closed_here: bool,
    pub(super) closed_there: bool,
}

impl Session {
    pub(super) fn new(worker: usize, id: WorkerId, quality: Quality) -> Self {
        Self {
            worker,
            id,
            key: None,
            ready: false,
            up: Way::new(quality),
            down: Way::new(quality),
            beats: Way::new(quality),
            owed: BTreeSet::new(),
            closed_here: false,
            closed_there: false,
        }
    }
}
