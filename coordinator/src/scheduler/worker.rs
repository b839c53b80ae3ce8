//! What the scheduler knows of one worker.

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use tessera_proto::{InstanceId, LeaseId};

use super::crowd::{Preference, Share};
use super::line::Line;
use super::{MAX_DEPTH, Model};

/// Where a worker is in its life; see the scheduler's drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Preparing { since: Duration },
    Ready,
    Draining,
}

/// A delivery as the scheduler sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Delivery {
    /// Pixels.
    pub(super) area: u64,
    /// Time spent on it, and time the worker stood still before it.
    pub(super) busy: Duration,
    pub(super) idle: Duration,
    /// When its lease was granted, and [`Worker::busy`] at that time.
    pub(super) granted: Duration,
    pub(super) busy_before: Duration,
}

#[derive(Debug)]
pub(super) struct Worker {
    pub(super) threads: u32,
    pub(super) instance: InstanceId,
    pub(super) phase: Phase,
    pub(super) last_heard: Duration,
    /// Nothing was heard of it for a while.
    pub(super) suspect: bool,
    /// It has long been due to deliver.
    pub(super) stuck: bool,
    /// Whether it is known to deliver: it did, or it is the coordinator's own.
    pub(super) proven: bool,
    /// Open leases, in the order in which it will render them.
    pub(super) leases: VecDeque<LeaseId>,
    /// Pixels of the open leases.
    pub(super) held: u64,
    /// Leases that are not wanted any more and that it has not answered.
    pub(super) revoked: BTreeSet<LeaseId>,
    /// Leases it renders at once.
    pub(super) running: usize,
    /// Leases it should hold, so that it never waits for the next.
    pub(super) depth: usize,
    /// Pixels a second, once measured: over its last few tiles.
    pub(super) rate: Option<f64>,
    /// Over how many seconds that was measured.
    pub(super) measured: f64,
    /// The least that `rate` would have been by one tile alone.
    pub(super) slowest: Option<f64>,
    /// Time it said it spent on tiles.
    pub(super) busy: Duration,
    /// When it last answered, or became ready.
    pub(super) last_answer: Duration,
    pub(super) line: Line,
    /// What of it is in the sums.
    pub(super) counted: Option<Share>,
    /// Its place among those with room.
    pub(super) place: Option<Preference>,
}

impl Worker {
    /// `own`: it runs in the coordinator's process.
    pub(super) fn new(threads: u32, instance: InstanceId, own: bool, line: Line, now: Duration) -> Self {
        let running = running(threads);
        Self {
            threads,
            instance,
            phase: Phase::Preparing { since: now },
            last_heard: now,
            suspect: false,
            stuck: false,
            proven: own,
            leases: VecDeque::new(),
            held: 0,
            revoked: BTreeSet::new(),
            running,
            depth: running + 1,
            rate: None,
            measured: 0.0,
            slowest: None,
            busy: Duration::ZERO,
            last_answer: now,
            line,
            counted: None,
            place: None,
        }
    }

    /// Whether it may be given a lease.
    pub(super) fn is_fit(&self) -> bool {
        self.phase == Phase::Ready && self.is_alive()
    }

    /// Whether what it holds can be expected of it.
    pub(super) fn is_alive(&self) -> bool {
        !self.suspect && !self.stuck
    }

    /// Whether it may still be at work on what is not wanted any more, with all its threads: nobody knows for how
    /// long.
    pub(super) fn is_occupied(&self) -> bool {
        self.revoked.len() >= self.running
    }

    /// Pixels a second that it renders and delivers, once measured.
    pub(super) fn pace(&self) -> Option<f64> {
        self.rate.map(|rate| self.line.pace(rate))
    }

    /// Learns from a delivery. `was_full`: it held all the leases meant for it, so that waiting for more was
    /// not for want of work.
    pub(super) fn delivered(&mut self, d: Delivery, was_full: bool, now: Duration, model: &Model) {
        let rate = d.area as f64 / d.busy.as_secs_f64().max(1e-6);
        let measured_before = self.rate.is_some();
        // The first tile warms up memory and tells little.
        if measured_before {
            self.slowest = Some(self.slowest.map_or(rate, |old| old.min(rate)));
        }
        // By the time it was at work rather than tile by tile: of two that it rendered at once, the second to end took
        // next to no time of its own.
        let before = self.rate.map_or(0.0, |_| model.memory * self.measured);
        self.measured = before + d.busy.as_secs_f64().max(1e-6);
        self.rate = Some((self.rate.unwrap_or(0.0) * before + d.area as f64) / self.measured);
        // What it rendered meanwhile was not spent on the way.
        let rendering = self.busy.saturating_sub(d.busy_before);
        let lag = now.saturating_sub(d.granted).saturating_sub(rendering);
        let in_use = self.line.window().is_none_or(|w| 2 * (self.held + d.area) >= w as u64);
        self.line.arrived(lag, d.granted, in_use, now);
        if measured_before && was_full && 10 * d.idle > d.busy && self.depth < MAX_DEPTH && !self.line.is_full() {
            self.depth += 1;
        }
        self.proven = true;
    }
}

/// How many leases a worker of `threads` threads renders at once: two where many threads could
/// stand still while the last ones finish a tile.
pub(crate) fn running(threads: u32) -> usize {
    if threads > 1 { 2 } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::super::MODEL;
    use super::*;

    /// Two tiles rendered at once often end together: the second has next to no time of its own.
    #[test]
    fn tiles_that_end_together_make_no_worker_fast() {
        let mut w = Worker::new(16, InstanceId(1), true, Line::new(true, 12, &MODEL), Duration::ZERO);
        let ms = Duration::from_millis;
        for n in 0..100 {
            let busy = if n % 2 == 0 { ms(100) } else { Duration::from_micros(5) };
            let d = Delivery { area: 1000, busy, idle: ms(0), granted: ms(0), busy_before: ms(0) };
            w.delivered(d, true, ms(0), &MODEL);
            let rate = w.rate.unwrap();
            assert!(n < 10 || (rate > 15_000.0 && rate < 27_000.0), "{rate} pixels a second rather than 20,000");
        }
    }
}
