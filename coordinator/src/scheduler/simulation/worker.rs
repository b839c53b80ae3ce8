//! A worker as the coordinator knows one: it dials, registers, prepares, renders its leases in their order,
//! beats, returns what it has not begun, and dials again when the connection breaks.

use std::time::Duration;

use tessera_proto::InstanceId;

use super::faults::Lie;
use crate::simulation::network::Quality;
use crate::simulation::renderer::Renderer;

/// See the [module](self).
#[derive(Debug)]
pub(super) struct SimWorker {
    pub(super) instance: InstanceId,
    pub(super) renderer: Renderer,
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
            renderer: Renderer::new(threads, speed),
            quality,
            epoch: 0,
            up: true,
            session: None,
            prepared: false,
            draining: false,
            frozen_until: Duration::ZERO,
            stuck_until: Duration::ZERO,
            lie: None,
            last_reply: Duration::ZERO,
            wait: Duration::from_millis(200),
        }
    }

    /// Forgets a session.
    pub(super) fn end_session(&mut self) {
        self.epoch += 1;
        self.session = None;
        self.renderer.clear();
    }

    /// The wait before it dials again.
    pub(super) fn next_wait(&mut self, rng: &mut fastrand::Rng) -> Duration {
        let wait = self.wait;
        self.wait = (2 * wait).min(Duration::from_secs(10));
        wait.mul_f64(0.5 + 0.5 * rng.f64())
    }
}
