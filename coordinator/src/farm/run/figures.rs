//! What is known of each worker, as it is shown and reported.

use std::collections::BTreeMap;

use tessera_core::film::Region;
use tessera_proto::convert::TileDone;
use tessera_proto::identity::WorkerId;
use tokio::sync::watch;

use super::{Member, Note, Run};
use crate::film::TileNote;
use crate::progress::{Progress, WorkerStats};
use crate::scheduler::WorkerKey;

impl Run {
    /// Enters a worker's figures, and gives their place.
    pub(super) fn enter(&mut self, id: WorkerId, came: WorkerStats) -> usize {
        let (roster, mut place) = (&mut self.roster, usize::MAX);
        self.progress.send_modify(|p| place = roster.enter(id, came, &mut p.workers).place);
        place
    }

    /// What those who look at the picture are told of a tile; `error` is the picture's so far.
    pub(super) fn note_of(&self, region: Region, done: &TileDone, (name, error): (&str, Option<f64>)) -> TileNote {
        TileNote {
            region,
            worker: name.into(),
            pass: self.passes.at_hand().0,
            so_far: error.map(|error| (self.start.elapsed().as_secs_f64(), 255.0 * error)),
            error: (done.error.pixels > 0).then(|| 255.0 * done.error.expected_rmse()),
            rays: done.rays.total(),
            busy_us: u64::try_from(done.busy.as_micros()).unwrap_or(u64::MAX),
        }
    }

    pub(super) fn name(&self, worker: WorkerKey) -> String {
        name(&self.progress, &self.members, worker)
    }

    pub(super) fn figures(&self, worker: WorkerKey, change: impl FnOnce(&mut WorkerStats)) {
        let Some(place) = self.members.get(&worker).map(|m| m.place) else { return };
        self.progress.send_modify(|p| {
            if let Some(w) = p.workers.get_mut(place) {
                change(w);
            }
        });
    }

    /// Counts a tile; gives the error of the picture so far.
    pub(super) fn count(&mut self, worker: WorkerKey, region: Region, done: &TileDone) -> Option<f64> {
        let (tiles_total, earlier, elapsed) =
            (self.scheduler.tiles_estimate(), self.tiles_of_pass, self.start.elapsed());
        let error = self.passes.error_so_far();
        self.pace.add(self.passes.work(&region));
        let (share, remaining) = self.pace.tell(elapsed);
        let place = self.members.get(&worker).map(|m| m.place);
        self.notes.push(Note::Counted { worker, pixels: region.area(), rays: done.rays, busy: done.busy });
        self.progress.send_modify(|p| {
            p.tiles_done += 1;
            p.tiles_total = (tiles_total + earlier).max(p.tiles_done);
            p.pixels_done += region.area();
            p.rays += done.rays;
            (p.elapsed, p.share, p.remaining, p.error) = (elapsed, share, remaining, error);
            if let Some(w) = place.and_then(|place| p.workers.get_mut(place)) {
                w.tiles += 1;
                w.pixels += region.area();
                w.rays += done.rays;
                w.busy += done.busy;
            }
        });
        error
    }
}

/// The name under which a worker is shown.
pub(super) fn name(
    progress: &watch::Sender<Progress>,
    members: &BTreeMap<WorkerKey, Member>,
    worker: WorkerKey,
) -> String {
    let progress = progress.borrow();
    let stats = members.get(&worker).and_then(|m| progress.workers.get(m.place));
    stats.map_or_else(|| "a worker".into(), |w| w.name.clone())
}
