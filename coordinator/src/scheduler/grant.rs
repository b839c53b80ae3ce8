//! Who is given what.

use std::time::Duration;

use tessera_proto::LeaseId;
use tessera_proto::convert::Lease;

use super::{Attempt, Effect, MAX_DEPTH, Open, Scheduler, Tile, WorkerKey};

/// Tiles that are wanted, and workers for each of them, that are looked at in one event: more than ever matter,
/// since who may not take a tile holds it or failed at it.
const WANTED_LOOKED_AT: usize = 16;
const WORKERS_LOOKED_AT: usize = 64;

impl Scheduler {
    /// Gives leases to everyone who has room for them; `about`: of whom something was heard.
    pub(super) fn grant_all(&mut self, about: Option<WorkerKey>, effects: &mut Vec<Effect>) {
        // The fewest leases first, so that the first to come does not take it all.
        while let Some(&(_, _, worker)) = self.room.first() {
            let Some(tile) = self.cut_for(worker) else { break };
            self.grant(worker, tile, effects);
        }
        if let Some(worker) = about {
            while self.wants_more(worker) {
                let Some(tile) = self.cut_for(worker) else { break };
                self.grant(worker, tile, effects);
            }
        }
        if self.cutter.pixels_left() == 0 {
            self.grant_wanted(effects);
        }
        self.assist(effects);
    }

    /// Whether a worker that holds the leases it should has little work with them.
    fn wants_more(&self, worker: WorkerKey) -> bool {
        let Some(w) = self.workers.get(&worker).filter(|w| w.is_fit()) else { return false };
        let Some(rate) = w.rate.filter(|_| w.leases.len() < MAX_DEPTH) else { return false };
        let held = w.held as f64;
        let rendering = Duration::from_secs_f64((held / rate.max(1.0)).min(1e9));
        // Not what others will be waiting for, and not what only waits on the way.
        rendering < self.config.model.ahead.min(self.rest() / 2) && w.line.window().is_none_or(|window| held < window)
    }

    /// A new tile for `worker`, while there is something to be cut.
    fn cut_for(&mut self, worker: WorkerKey) -> Option<u64> {
        if self.cutter.pixels_left() == 0 {
            return None;
        }
        let region = self.cutter.take(self.area_for(worker))?;
        let id = self.next_tile;
        self.next_tile += 1;
        let tile = Tile {
            region,
            number: self.number,
            leases: Vec::new(),
            attempts: 0,
            strikes: Vec::new(),
            doubts: 0,
            again_at: Duration::ZERO,
            wanted: None,
        };
        self.tiles.insert(id, tile);
        Some(id)
    }

    /// Gives tiles that no lease of counts to workers with room.
    fn grant_wanted(&mut self, effects: &mut Vec<Effect>) {
        if self.wanted.is_empty() || self.room.is_empty() {
            return;
        }
        let wanted: Vec<u64> = self.wanted.iter().take(WANTED_LOOKED_AT).map(|(_, id)| *id).collect();
        for id in wanted {
            let taker = self.room.iter().take(WORKERS_LOOKED_AT).find(|(_, _, worker)| self.may_take(*worker, id));
            if let Some(&(_, _, worker)) = taker {
                self.grant(worker, id, effects);
            }
        }
    }

    /// Whether a tile may go to `worker`: not where it failed at it and somebody else is there; where it is in doubt,
    /// not to a stranger while somebody is there who is known to deliver, and not beside another one in doubt.
    pub(super) fn may_take(&self, worker: WorkerKey, id: u64) -> bool {
        let (Some(w), Some(tile)) = (self.workers.get(&worker), self.tiles.get(&id)) else { return false };
        if !tile.is_doubtful() || tile.again_at > self.now {
            return !tile.is_doubtful();
        }
        let is_doubtful = |l: &LeaseId| self.open.get(l).is_some_and(|o| self.doubtful.contains(&o.tile));
        if w.leases.iter().any(is_doubtful) {
            return false;
        }
        let strikers = tile.strikers();
        let fit = strikers.iter().filter_map(|i| self.workers.get(self.instances.get(i)?)).filter(|w| w.is_fit());
        let others_proven = self.crowd.proven - fit.clone().filter(|w| w.proven).count();
        let others = self.crowd.count - fit.count();
        let struck = strikers.binary_search(&w.instance).is_ok();
        if struck { others == 0 } else { w.proven || others_proven == 0 }
    }

    pub(super) fn grant(&mut self, worker: WorkerKey, id: u64, effects: &mut Vec<Effect>) {
        let (Some(tile), Some(w)) = (self.tiles.get_mut(&id), self.workers.get_mut(&worker)) else { return };
        let lease = LeaseId(self.next_lease);
        let attempt = Attempt(tile.attempts);
        self.next_lease += 1;
        tile.attempts += 1;
        tile.leases.push(lease);
        w.leases.push_back(lease);
        w.held += tile.region.area();
        let open = Open { worker, tile: id, attempt, granted: self.now, busy_before: w.busy };
        self.open.insert(lease, open);
        let lease = Lease { id: lease, attempt, region: tile.region, number: tile.number, pass: self.pass };
        effects.push(Effect::Grant { worker, lease });
        self.want(id);
        self.refresh(worker);
    }
}
