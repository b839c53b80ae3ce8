//! What simulated workers and coordinators tell each other, in this simulation and in that of faults.

use std::time::Duration;

use tessera_core::film::Region;
use tessera_proto::convert::Lease;
use tessera_proto::{Attempt, LeaseId};

/// What a worker says.
#[derive(Clone, Debug)]
#[cfg_attr(not(test), expect(dead_code, reason = "without faults, less is said"))]
pub(crate) enum FromWorker {
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
#[cfg_attr(not(test), expect(dead_code, reason = "without faults, less is said"))]
pub(crate) enum FromCoordinator {
    Welcome,
    Lease(Lease),
    Revoke(LeaseId),
    BeatReply,
    Closed,
}
