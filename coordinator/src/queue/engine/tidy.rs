//! What the queue's thread does unasked: jobs that are late, and those that need not be kept.

use std::collections::HashSet;
use std::time::Duration;

use tessera_proto::SceneHash;
use tessera_proto::control::{Job, State};

use super::{Engine, LOOK_EVERY};
use crate::farm::Order;
use crate::queue::keep::{Finished, Keep};
use crate::queue::{Entry, is_final, now_ms};

impl Engine {
    /// Gives up the jobs whose deadline has passed; gives the time to the next one.
    pub(super) fn give_up(&mut self) -> Duration {
        while let Some(&(deadline, id)) = self.deadlines.first() {
            let now = now_ms();
            if deadline > now {
                return Duration::from_millis(deadline - now);
            }
            self.deadlines.pop_first();
            self.failed(id, "its deadline passed; what is done is kept, and 'resume' goes on without one".into());
            self.stop(id);
            self.choose();
        }
        LOOK_EVERY
    }

    /// Forgets finished jobs that need not be kept, and scenes of no job.
    pub(super) fn tidy(&mut self) {
        if self.keep == Keep::All {
            return;
        }
        let size = |hash: &[u8]| {
            let path = hash.try_into().map(|hash| self.store.pixels(hash));
            path.ok().and_then(|path| std::fs::metadata(path).ok()).map_or(0, |m| m.len())
        };
        let finished: Vec<Finished> = self
            .jobs
            .entries()
            .values()
            .filter(|e| is_final(e.job.state()))
            .map(|Entry { job, .. }| Finished {
                id: job.id,
                bytes: job.result.as_ref().map_or(0, |r| size(&r.pixels_sha256)),
                ended_ms: job.ended_ms,
                fetched: job.fetched_ms > 0 || job.state() != State::Done,
            })
            .collect();
        let gone = self.keep.superfluous(&finished, now_ms());
        if gone.is_empty() {
            return;
        }
        if let Err(e) = self.store.remove(&gone) {
            return tracing::error!("finished jobs cannot be forgotten: {e}");
        }
        let mut entries = self.jobs.entries();
        let removed: Vec<Job> = gone.iter().filter_map(|id| entries.remove(id)).map(|e| e.job).collect();
        let scene = |job: &Job| job.spec.as_ref().and_then(|s| s.scene.as_ref()).map(|s| s.sha256.clone());
        let scenes: HashSet<_> = entries.values().filter_map(|e| scene(&e.job)).collect();
        let pictures: HashSet<_> =
            entries.values().filter_map(|e| e.job.result.as_ref()).map(|r| r.pixels_sha256.clone()).collect();
        drop(entries);
        self.finished.retain(|_, id| !gone.contains(id));
        for job in &removed {
            let _ = std::fs::remove_file(self.store.journal(job.id));
            let pixels = job.result.as_ref().map(|r| &r.pixels_sha256).filter(|h| !pictures.contains(*h));
            if let Some(Ok(hash)) = pixels.map(|h| h.as_slice().try_into()) {
                let _ = std::fs::remove_file(self.store.pixels(hash));
            }
            if let Some(hash) = scene(job).filter(|h| !scenes.contains(h))
                && let Ok(hash) = hash.try_into().map(SceneHash)
            {
                let _ = std::fs::remove_file(self.store.scene(hash));
                let _ = self.orders.try_send(Order::Forget(hash));
            }
        }
        self.jobs.changed.send_modify(|n| *n += 1);
    }
}
