//! What the scheduler knows of one worker.

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use tessera_proto::{InstanceId, LeaseId};

use super::MAX_DEPTH;

/// Where a worker is in its life; see the scheduler's drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Preparing { since: Duration },
    Ready,
    Draining,
}

#[derive(Debug)]
pub(super) struct Worker {
    pub(super) threads: u32,
    pub(super) instance: InstanceId,
    pub(super) phase: Phase,
    pub(super) last_heard: Duration,
    pub(super) suspect: bool,
    /// Open leases, in the order in which it will render them.
    pub(super) leases: VecDeque<LeaseId>,
    /// Leases that are not wanted any more and that it has not answered.
    pub(super) revoked: BTreeSet<LeaseId>,
    /// Leases it renders at once.
    pub(super) running: usize,
    /// Leases it should hold, so that it never waits for the next.
    pub(super) depth: usize,
    /// Pixels a second, once measured.
    pub(super) rate: Option<f64>,
    /// The least that `rate` would have been by one tile alone.
    pub(super) slowest: Option<f64>,
    /// When it last delivered, or became idle or ready.
    pub(super) last_delivery: Duration,
}

impl Worker {
    pub(super) fn new(threads: u32, instance: InstanceId, now: Duration) -> Self {
        let running = running(threads);
        Self {
            threads,
            instance,
            phase: Phase::Preparing { since: now },
            last_heard: now,
            suspect: false,
            leases: VecDeque::new(),
            revoked: BTreeSet::new(),
            running,
            depth: running + 1,
            rate: None,
            slowest: None,
            last_delivery: now,
        }
    }

    /// Whether it may be given a lease.
    pub(super) fn is_fit(&self) -> bool {
        self.phase == Phase::Ready && !self.suspect
    }

    /// Learns from a delivery of `area` pixels. `was_full`: it held all the leases meant for it,
    /// so that waiting for more was not for want of work.
    pub(super) fn delivered(&mut self, area: u64, busy: Duration, idle: Duration, was_full: bool, now: Duration) {
        let rate = area as f64 / busy.as_secs_f64().max(1e-6);
        // Neighbouring tiles are alike, but one cheap tile should not set the size of all.
        let measured_before = self.rate.is_some();
        // The first tile warms up memory and tells little.
        if measured_before {
            self.slowest = Some(self.slowest.map_or(rate, |old| old.min(rate)));
        }
        self.rate = Some(self.rate.map_or(rate, |old| (old * rate).sqrt()));
        if measured_before && was_full && 10 * idle > busy && self.depth < MAX_DEPTH {
            self.depth += 1;
        }
        self.last_delivery = now;
    }
}

/// How many leases a worker of `threads` threads renders at once: two where many threads could
/// stand still while the last ones finish a tile.
pub(super) fn running(threads: u32) -> usize {
    if threads > 1 { 2 } else { 1 }
}
