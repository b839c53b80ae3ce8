//! A worker as the coordinator knows one: it dials, registers, prepares, renders its leases in their order,
//! beats, returns what it has not begun, and dials again when the connection breaks.

use std::collections::VecDeque;
use std::time::Duration;

use tessera_proto::convert::Lease;
use tessera_proto::{InstanceId, LeaseId};

use super::faults::Lie;
use super::network::Quality;

/// A lease at work.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtWork {
    pub(super) lease: Lease,
    pub(super) start: Duration,
    pub(super) idle: Duration,
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct SimWorker {
    pub(super) instance: InstanceId,
    pub(super) threads: u32,
    /// Pixels of usual cost a second.
    pub(super) speed: f64,
    pub(super) quality: Quality,
    /// Changes with every new session and process: what was meant for an earlier one is void.
    pub(super) epoch: u64,
    /// Whether its process runs.
    pub(super) up: bool,
    pub(super) session: Option<usize>,
    pub(super) prepared: bool,
    pub(super) draining: bool,
    pub(super) frozen_until: Duration,
    pub(super) stuck_until: Duration,
    pub(super) lie: Option<Lie>,
    pub(super) queue: VecDeque<Lease>,
    pub(super) at_work: Vec<AtWork>,
    /// Threads that wait for the network to take what they rendered.
    pub(super) sending: usize,
    pub(super) last_end: Duration,
    pub(super) last_sent: Duration,
    pub(super) last_reply: Duration,
    /// The next wait before dialling again.
    pub(super) wait: Duration,
}

/// Longer than any run lasts.
pub(super) const FOR_EVER: Duration = Duration::from_secs(1 << 30);

impl SimWorker {
    pub(super) fn new(instance: InstanceId, threads: u32, speed: f64, quality: Quality) -> Self {
        Self {
            instance,
            threads,
            speed,
            quality,
            epoch: 0,
            up: true,
            session: None,
            prepared: false,
            draining: false,
            frozen_until: Duration::ZERO,
            stuck_until: Duration::ZERO,
            lie: None,
            queue: VecDeque::new(),
            at_work: Vec::new(),
            sending: 0,
            last_end: Duration::ZERO,
            last_sent: Duration::ZERO,
            last_reply: Duration::ZERO,
            wait: Duration::from_millis(200),
        }
    }

    /// Forgets a session.
    pub(super) fn end_session(&mut self) {
        self.epoch += 1;
        self.session = None;
        self.queue.clear();
        self.at_work.clear();
        self.sending = 0;
    }

    /// The wait before it dials again.
    pub(super) fn next_wait(&mut self, rng: &mut fastrand::Rng) -> Duration {
        let wait = self.wait;
        self.wait = (2 * wait).min(Duration::from_secs(10));
        wait.mul_f64(0.5 + 0.5 * rng.f64())
    }

    /// Begins the next lease, if it can: gives it, and how long it takes.
    pub(super) fn begin(&mut self, now: Duration, cost: impl Fn(&Lease) -> f64) -> Option<(LeaseId, Duration)> {
        let at_once = super::super::worker::running(self.threads);
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
    pub(super) fn finish(&mut self, id: LeaseId, now: Duration) -> Option<(Lease, Duration, Duration)> {
        let at = self.at_work.iter().position(|a| a.lease.id == id)?;
        let AtWork { lease, start, idle } = self.at_work.remove(at);
        let busy = now.saturating_sub(start.max(self.last_end));
        self.last_end = now;
        Some((lease, busy, idle))
    }
}
