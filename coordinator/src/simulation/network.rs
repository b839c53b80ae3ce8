//! A simulated network: two ways between a worker and the coordinator, each in order and without losing
//! anything, as TCP is, at its own pace.

use std::time::Duration;

/// What a line is like.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quality {
    /// One way.
    pub(crate) delay: Duration,
    pub(crate) bytes_per_second: f64,
    /// The share of messages that are sent a second time.
    pub(crate) loss: f64,
}

#[cfg(test)]
impl Quality {
    /// A local network, an ocean, or a line of 1 Mbit/s.
    pub(crate) fn any(rng: &mut fastrand::Rng) -> Self {
        let ms = |ms: f64| Duration::from_secs_f64(ms / 1e3);
        match rng.u32(0..10) {
            0..6 => Self { delay: ms(0.2), bytes_per_second: 1.2e8, loss: 0.0 },
            6..8 => Self { delay: ms(10.0 + 190.0 * rng.f64()), bytes_per_second: 1.2e7, loss: 0.05 * rng.f64() },
            _ => Self { delay: ms(20.0), bytes_per_second: 1.25e5, loss: 0.02 },
        }
    }
}

/// One way of a connection.
#[derive(Debug)]
pub(crate) struct Way<M> {
    quality: Quality,
    /// When what was sent before is through.
    free_at: Duration,
    /// When the last message arrives.
    last: Duration,
    /// Nothing passes; what is sent waits.
    blocked: bool,
    waiting: Vec<(M, usize)>,
}

impl<M> Way<M> {
    pub(crate) fn new(quality: Quality) -> Self {
        Self { quality, free_at: Duration::ZERO, last: Duration::ZERO, blocked: false, waiting: Vec::new() }
    }

    /// Sends: gives when the message begins to arrive and when it is there, or nothing where it has to wait.
    pub(crate) fn send(
        &mut self,
        message: M,
        bytes: usize,
        now: Duration,
        rng: &mut fastrand::Rng,
    ) -> Option<(M, Duration, Duration)> {
        if self.blocked {
            self.waiting.push((message, bytes));
            return None;
        }
        let Quality { delay, bytes_per_second, loss } = self.quality;
        let begins = self.free_at.max(now);
        self.free_at = begins + Duration::from_secs_f64(bytes as f64 / bytes_per_second);
        let again = if rng.f64() < loss { Duration::from_millis(200) + 2 * delay } else { Duration::ZERO };
        self.last = self.last.max(self.free_at + delay + again);
        Some((message, begins + delay, self.last))
    }

    /// Stops everything, or lets it pass again; gives what waited.
    pub(crate) fn block(&mut self, blocked: bool) -> Vec<(M, usize)> {
        self.blocked = blocked;
        if blocked { Vec::new() } else { std::mem::take(&mut self.waiting) }
    }

    /// When no more than a socket's buffer waits to be sent.
    pub(crate) fn room_at(&self) -> Duration {
        const BUFFER: f64 = 262_144.0;
        self.free_at.saturating_sub(Duration::from_secs_f64(BUFFER / self.quality.bytes_per_second))
    }
}
