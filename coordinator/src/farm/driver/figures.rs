//! What is known of each worker, as it is shown and reported.

use tessera_core::film::Region;
use tessera_proto::InstanceId;
use tessera_proto::convert::{Registration, TileDone};

use super::{Driver, FARM};
use crate::farm::roster::Entered;
use crate::farm::service::{BROKE, IN_PEACE};
use crate::job::WorkerStats;
use crate::scheduler::WorkerKey;

impl Driver {
    /// Enters a worker's figures. Names like those of this process' own are theirs alone.
    pub(super) fn enter(&mut self, registration: &Registration, local: bool, address: String) -> Entered {
        let name = registration.name.clone();
        let name = if !local && name.starts_with("local-") { format!("{name} (remote)") } else { name };
        let came = WorkerStats { name, threads: registration.threads, address, ..WorkerStats::default() };
        let (roster, mut entered) = (&mut self.roster, None::<Entered>);
        self.progress.send_modify(|p| entered = Some(roster.enter(registration.id, came.clone(), &mut p.workers)));
        entered.unwrap_or(Entered { instance: InstanceId(u64::MAX), place: usize::MAX, name: came.name, back: false })
    }

    /// Says that a worker left, in the farm's words; what lies beneath only to whoever asks for it.
    pub(super) fn say_left(&self, worker: WorkerKey, cause: &str) {
        let name = self.name(worker);
        let lost = match self.seats.get(&worker).map_or(0, |s| s.lost) {
            0 => String::new(),
            1 => "; 1 tile given to others".into(),
            n => format!("; {n} tiles given to others"),
        };
        if cause == IN_PEACE && self.seats.get(&worker).is_some_and(|s| s.own) {
            tracing::debug!("{name} left{lost}");
        } else if cause == IN_PEACE {
            tracing::info!(target: FARM, "{name} left{lost}");
        } else if cause.starts_with(BROKE) {
            tracing::warn!(target: FARM, "{name} left: connection lost{lost}");
            tracing::info!("{name}: {cause}");
        } else {
            tracing::warn!(target: FARM, "{name} left: {cause}{lost}");
        }
    }

    pub(super) fn name(&self, worker: WorkerKey) -> String {
        let progress = self.progress.borrow();
        let stats = self.seats.get(&worker).and_then(|s| progress.workers.get(s.place));
        stats.map_or_else(|| "a worker".into(), |w| w.name.clone())
    }

    pub(super) fn figures(&self, worker: WorkerKey, change: impl FnOnce(&mut WorkerStats)) {
        let Some(place) = self.seats.get(&worker).map(|s| s.place) else { return };
        self.progress.send_modify(|p| {
            if let Some(w) = p.workers.get_mut(place) {
                change(w);
            }
        });
    }

    pub(super) fn count(&mut self, worker: WorkerKey, region: Region, done: &TileDone) {
        let (tiles_total, earlier, elapsed) =
            (self.scheduler.tiles_estimate(), self.tiles_of_pass, self.start.elapsed());
        self.pace.add(self.passes.work(&region));
        let (share, remaining) = self.pace.tell(elapsed);
        let place = self.seats.get(&worker).map(|s| s.place);
        self.progress.send_modify(|p| {
            p.tiles_done += 1;
            p.tiles_total = (tiles_total + earlier).max(p.tiles_done);
            p.pixels_done += region.area();
            p.rays += done.rays;
            (p.elapsed, p.share, p.remaining) = (elapsed, share, remaining);
            if let Some(w) = place.and_then(|place| p.workers.get_mut(place)) {
                w.tiles += 1;
                w.pixels += region.area();
                w.rays += done.rays;
                w.busy += done.busy;
            }
        });
    }
}
