//! A connection of a worker, as both ends see it, and what is said over it.

use std::collections::BTreeSet;
use std::time::Duration;

use tessera_core::film::Region;
use tessera_proto::convert::Lease;
use tessera_proto::identity::WorkerId;
use tessera_proto::{Attempt, LeaseId};

use super::super::WorkerKey;
use crate::simulation::network::{Quality, Way};

/// What a worker says.
#[derive(Clone, Debug)]
pub(super) enum Up {
    Register,
    Ready,
    /// A tile, and which region it shows.
    Done {
        lease: LeaseId,
        attempt: Attempt,
        shows: Region,
        /// Whether its pixels are not what they should be.
        lies: bool,
        busy: Duration,
        idle: Duration,
    },
    Failed {
        lease: LeaseId,
        attempt: Attempt,
    },
    Returned {
        lease: LeaseId,
        attempt: Attempt,
    },
    Garbage,
    Draining,
    /// Bytes of a longer message.
    Bytes,
    Beat,
    /// The worker's end of the connection is closed.
    Closed,
}

/// What a coordinator says.
#[derive(Clone, Debug)]
pub(super) enum Down {
    Welcome,
    Lease(Lease),
    Revoke(LeaseId),
    BeatReply,
    Closed,
}

#[derive(Debug)]
pub(super) struct Session {
    pub(super) worker: usize,
    /// Which worker that was then: one that is killed comes back as another.
    pub(super) id: WorkerId,
    /// As the coordinator knows it, from registration until it is gone.
    pub(super) key: Option<WorkerKey>,
    pub(super) up: Way<Up>,
    pub(super) down: Way<Down>,
    /// Beats have a connection of their own.
    pub(super) beats: Way<Up>,
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
