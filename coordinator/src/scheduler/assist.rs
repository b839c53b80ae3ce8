//! Who helps whom at the end of a pass.

use std::time::Duration;

use tessera_proto::LeaseId;

use super::crowd::Preference;
use super::worker::Worker;
use super::{Effect, MAX_COPIES, Scheduler, Tile, WorkerKey};

/// Tiles that each idle worker looks at.
const LOOKED_AT: usize = 16;
/// After so many workers lost with no delivery between, every tile is leased once at a time: then it can be told
/// which of them is to blame.
const CAREFUL: usize = 8;

/// A tile that its holders will finish late.
#[derive(Clone, Copy, Debug)]
struct Late {
    tile: u64,
    area: u64,
    /// How long they will still take; for ever where they are overdue.
    rest: Duration,
    /// When they will be overdue.
    due: Duration,
    /// Whether one of them is likely to have begun it.
    begun: bool,
    /// How many of them are not overdue.
    copies: usize,
}

impl Scheduler {
    /// When nothing is left to be cut, lets idle workers render what others will finish late: the latest first.
    pub(super) fn assist(&mut self, effects: &mut Vec<Effect>) {
        self.assist_at = None;
        let is_free = |&&(leases, _, _): &&Preference| leases == 0;
        if self.cutter.pixels_left() > 0 || self.open.is_empty() || self.room.first().filter(is_free).is_none() {
            return;
        }
        let next = self.assisted + self.config.model.look_every * (self.open.len() + self.workers.len()) as u32;
        if self.now < next && self.assisted > Duration::ZERO {
            self.assist_at = Some(next);
            return;
        }
        let free = self.room.iter().take_while(is_free).map(|(_, _, worker)| *worker);
        let idle: Vec<WorkerKey> =
            free.filter(|worker| self.workers.get(worker).is_some_and(|w| !w.is_occupied())).collect();
        if idle.is_empty() {
            return;
        }
        self.assisted = self.now;
        let mut late = self.outlook();
        late.sort_unstable_by_key(|l| (std::cmp::Reverse(l.rest), l.tile));
        for worker in idle {
            if let Some(at) = late.iter().take(LOOKED_AT).position(|l| self.is_worth(worker, l)) {
                let tile = late.remove(at).tile;
                self.grant(worker, tile, effects);
            }
        }
        self.assist_at = late.iter().map(|l| l.due).filter(|due| *due > self.now).min();
    }

    /// Whether `worker` would have it clearly sooner.
    fn is_worth(&self, worker: WorkerKey, late: &Late) -> bool {
        let (Some(tile), Some(w)) = (self.tiles.get(&late.tile), self.workers.get(&worker)) else { return false };
        let holds = |l: &LeaseId| self.open.get(l).is_some_and(|o| o.worker == worker);
        // What nobody has begun is taken off its holder as soon as that is quicker.
        let model = &self.config.model;
        let slack = if late.begun { model.slack } else { model.shortest } / 4;
        let own = self.time_for(worker, late.area) + w.line.lag();
        late.rest > own.mul_f64(model.quicker) + slack
            && !tile.leases.iter().any(holds)
            && self.may_take(worker, late.tile)
    }

    /// What the holders of every tile will still take for it, by their speed so far.
    fn outlook(&self) -> Vec<Late> {
        let mut all: Vec<Late> = Vec::with_capacity(self.open.len());
        for (&key, w) in &self.workers {
            self.add_outlook(key, w, &mut all);
        }
        // The best of each tile's holders counts.
        all.sort_unstable_by_key(|l| (l.tile, l.rest));
        all.dedup_by(|later, first| {
            let same = later.tile == first.tile;
            if same {
                first.begun |= later.begun;
                first.copies += later.copies;
                first.due = first.due.min(later.due);
            }
            same
        });
        // What may kill its workers is not given to many.
        let most = if self.is_careful() { 1 } else { MAX_COPIES };
        let doubt = |l: &Late| self.tiles.get(&l.tile).map_or(0, Tile::doubt);
        all.retain(|l| l.copies + doubt(l) < most);
        all
    }

    fn add_outlook(&self, key: WorkerKey, w: &Worker, all: &mut Vec<Late>) {
        let Some(front) = w.leases.front().and_then(|l| self.open.get(l)) else { return };
        let (began, occupied) = (front.granted.max(w.last_answer), w.is_occupied());
        let mut before = 0;
        for (place, lease) in w.leases.iter().enumerate() {
            let Some((id, tile)) = self.open.get(lease).and_then(|o| Some((o.tile, self.tiles.get(&o.tile)?))) else {
                continue;
            };
            let area = tile.region.area();
            before += area;
            let whole = self.time_for(key, before) + w.line.lag();
            let due = began + 2 * whole + self.config.model.slack;
            let overdue = !w.is_alive() || self.now >= due;
            let begins = if occupied { began.max(self.now) } else { began };
            // What is later than was expected will be later still by as much.
            let rest = if overdue { Duration::MAX } else { (begins + whole).abs_diff(self.now) };
            all.push(Late {
                tile: id,
                area,
                rest,
                due,
                begun: place < w.running && !occupied,
                copies: usize::from(!overdue && !occupied || self.is_careful()),
            });
        }
    }

    fn is_careful(&self) -> bool {
        self.losses_in_a_row >= CAREFUL
    }
}
