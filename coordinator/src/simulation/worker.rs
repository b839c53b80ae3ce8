//! A worker and its connection, as both ends see it.

use std::time::Duration;

use tessera_proto::InstanceId;

use super::message::{FromCoordinator, FromWorker};
use super::network::{Quality, Way};
use super::renderer::Renderer;
use crate::scheduler::WorkerKey;

/// See the [module](self).
#[derive(Debug)]
pub(super) struct SimWorker {
    pub(super) instance: InstanceId,
    pub(super) renderer: Renderer,
    pub(super) quality: Quality,
    pub(super) up: Way<(u32, FromWorker)>,
    pub(super) down: Way<(u32, FromCoordinator)>,
    /// Counts its sessions: what belongs to an earlier one is void.
    pub(super) epoch: u32,
    /// As the coordinator knows it, and for which session.
    pub(super) key: Option<(WorkerKey, u32)>,
    /// Since when its process is there.
    pub(super) since: Option<Duration>,
    /// Whether it has the scene.
    pub(super) prepared: bool,
    /// Until when nothing passes between it and the coordinator.
    pub(super) cut_until: Duration,
    /// Whether the coordinator took something of it since it last looked.
    pub(super) delivered: bool,
    /// Since when it waits to be able to render.
    pub(super) starting: Option<Duration>,
    pub(super) times: Times,
    /// When its last tile that counts was taken.
    pub(super) last: Option<Duration>,
}

/// Where a worker's time went.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Times {
    pub(super) present: Duration,
    /// On tiles that came into the picture.
    pub(super) useful: Duration,
    /// On others.
    pub(super) wasted: Duration,
    /// Connecting, and preparing the scene.
    pub(super) starting: Duration,
    /// Without a tile, while there were tiles to be had.
    pub(super) waiting: Duration,
}

impl SimWorker {
    pub(super) fn new(instance: InstanceId, renderer: Renderer, quality: Quality) -> Self {
        Self {
            instance,
            renderer,
            quality,
            up: Way::new(quality),
            down: Way::new(quality),
            epoch: 0,
            key: None,
            since: None,
            prepared: false,
            cut_until: Duration::ZERO,
            delivered: false,
            starting: None,
            times: Times::default(),
            last: None,
        }
    }

    /// Ends its session, and what it was doing.
    pub(super) fn end_session(&mut self, now: Duration) {
        self.epoch += 1;
        for at_work in &self.renderer.at_work {
            self.times.wasted += now.saturating_sub(at_work.start.max(self.renderer.last_end));
        }
        self.started(now);
        self.renderer.clear();
    }

    /// It can render, or will not for now.
    pub(super) fn started(&mut self, now: Duration) {
        if let Some(since) = self.starting.take() {
            self.times.starting += now - since;
        }
    }
}
