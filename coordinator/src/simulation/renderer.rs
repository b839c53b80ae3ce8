//! What renders a worker's leases: the queue before its threads, as the worker has one.

use std::collections::VecDeque;
use std::time::Duration;

use tessera_proto::LeaseId;
use tessera_proto::convert::Lease;

/// A lease at work.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AtWork {
    pub(crate) lease: Lease,
    pub(crate) start: Duration,
    pub(crate) idle: Duration,
}

/// Renders leases in their order, as many at once as a worker of so many threads does.
#[derive(Debug)]
pub(crate) struct Renderer {
    pub(crate) threads: u32,
    /// Pixels of usual cost a second, of all threads together.
    pub(crate) speed: f64,
    pub(crate) queue: VecDeque<Lease>,
    pub(crate) at_work: Vec<AtWork>,
    /// Threads that wait for the network to take what they rendered.
    pub(crate) sending: usize,
    pub(crate) last_end: Duration,
    pub(crate) last_sent: Duration,
}

impl Renderer {
    pub(crate) fn new(threads: u32, speed: f64) -> Self {
        Self {
            threads,
            speed,
            queue: VecDeque::new(),
            at_work: Vec::new(),
            sending: 0,
            last_end: Duration::ZERO,
            last_sent: Duration::ZERO,
        }
    }

    /// Forgets what it has.
    pub(crate) fn clear(&mut self) {
        self.queue.clear();
        self.at_work.clear();
        self.sending = 0;
    }

    /// Begins the next lease, if it can: gives it, and how long it takes. `cost` is in pixels of usual cost.
    pub(crate) fn begin(&mut self, now: Duration, cost: impl Fn(&Lease) -> f64) -> Option<(LeaseId, Duration)> {
        let at_once = crate::scheduler::running(self.threads);
        if self.at_work.len() + self.sending >= at_once {
            return None;
        }
        let lease = self.queue.pop_front()?;
        let alone = self.at_work.is_empty() && self.sending == 0;
        let idle = if alone { now.saturating_sub(self.last_end.max(self.last_sent)) } else { Duration::ZERO };
        self.at_work.push(AtWork { lease, start: now, idle });
        let time = at_once as f64 * cost(&lease) / self.speed;
        Some((lease.id, Duration::from_secs_f64(time)))
    }

    /// Ends a lease: gives it, and the time it took and stood still before.
    pub(crate) fn finish(&mut self, id: LeaseId, now: Duration) -> Option<(Lease, Duration, Duration)> {
        let at = self.at_work.iter().position(|a| a.lease.id == id)?;
        let AtWork { lease, start, idle } = self.at_work.remove(at);
        let busy = now.saturating_sub(start.max(self.last_end));
        self.last_end = now;
        Some((lease, busy, idle))
    }

    /// Takes a lease off the queue, if it has not begun.
    pub(crate) fn revoke(&mut self, id: LeaseId) -> Option<Lease> {
        let at = self.queue.iter().position(|l| l.id == id)?;
        self.queue.remove(at)
    }
}
