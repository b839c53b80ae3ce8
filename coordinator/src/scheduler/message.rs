//! What the scheduler is told, and what it asks for.

use std::time::Duration;

use tessera_core::film::Region;
use tessera_proto::convert::Lease;
use tessera_proto::{Attempt, InstanceId, LeaseId};

use super::Model;
use crate::config::{Patience, TileSize};

/// One session of a worker. Never used twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct WorkerKey(pub(crate) u64);

/// What a scheduler is told once.
#[derive(Clone, Debug)]
pub(crate) struct Config {
    /// The pixels to be rendered.
    pub(crate) region: Region,
    /// Edge of a tile.
    pub(crate) tile: TileSize,
    /// Samples a pixel: how much dearer than usual pixels are before any is measured.
    pub(crate) samples: u32,
    /// Workers that are known to come.
    pub(crate) expected: usize,
    /// Of a pixel in a worker's answers.
    pub(crate) bytes_per_pixel: u64,
    /// How long to go on without any worker.
    pub(crate) patience: Patience,
    /// Silence that makes a worker suspect.
    pub(crate) suspect_after: Duration,
    /// Silence that ends its session.
    pub(crate) dead_after: Duration,
    /// How long a worker may take to fetch and prepare the scene.
    pub(crate) prepare_within: Duration,
    /// What costs and times are taken to be.
    pub(crate) model: Model,
}

/// What happened.
#[derive(Clone, Debug)]
pub(crate) enum Event {
    /// A worker registered; `own`: one of the coordinator's process.
    Joined { worker: WorkerKey, threads: u32, instance: InstanceId, own: bool },
    /// It prepared the scene.
    Ready { worker: WorkerKey },
    /// It gave a sign of life.
    Heard { worker: WorkerKey },
    /// It delivered a tile of the right size.
    Done { worker: WorkerKey, lease: LeaseId, attempt: Attempt, busy: Duration, idle: Duration },
    /// It could not render a tile.
    Failed { worker: WorkerKey, lease: LeaseId, attempt: Attempt, cause: String },
    /// It returned a tile it had not begun.
    Returned { worker: WorkerKey, lease: LeaseId, attempt: Attempt },
    /// It will leave.
    Draining { worker: WorkerKey },
    /// It broke the protocol's rules.
    Broke { worker: WorkerKey, rule: String },
    /// Its stream ended.
    Left { worker: WorkerKey, cause: String },
    /// Time passed.
    Tick,
}

impl Event {
    /// Whom it is about.
    pub(crate) fn worker(&self) -> Option<WorkerKey> {
        match *self {
            Self::Joined { worker, .. }
            | Self::Ready { worker }
            | Self::Heard { worker }
            | Self::Done { worker, .. }
            | Self::Failed { worker, .. }
            | Self::Returned { worker, .. }
            | Self::Draining { worker }
            | Self::Broke { worker, .. }
            | Self::Left { worker, .. } => Some(worker),
            Self::Tick => None,
        }
    }
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Effect {
    /// Send a lease.
    Grant { worker: WorkerKey, lease: Lease },
    /// Send that a lease is not wanted.
    Revoke { worker: WorkerKey, lease: LeaseId },
    /// Put the tile just delivered into the picture.
    Accept { worker: WorkerKey, region: Region },
    /// End a session.
    CutOff { worker: WorkerKey, why: CutOff },
    /// A worker left with leases unanswered.
    Lost { worker: WorkerKey, tiles: u64 },
    /// End the render.
    End(End),
}

/// Why a session is ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum CutOff {
    /// It broke a rule.
    Broke(String),
    /// Nothing was heard of it.
    Silent(Duration),
    /// It never became ready.
    Unready(Duration),
}

/// How a render ends.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum End {
    /// Every pixel is done.
    Complete,
    /// Nobody was there.
    NoWorkers { waited: Duration, ever: bool },
    /// A tile cannot be rendered.
    TileFailed { region: Region, attempts: u32, cause: String },
}
