//! Workers come, get ready, leave and are sent away.

use tessera_proto::InstanceId;

use super::blame::{AtWork, Loss};
use super::crowd::Share;
use super::line::Line;
use super::worker::{Phase, Worker};
use super::{CutOff, Effect, Scheduler, WorkerKey};

impl Scheduler {
    pub(super) fn joined(&mut self, worker: WorkerKey, threads: u32, instance: InstanceId, own: bool) {
        self.returns(instance);
        let line = Line::new(own, self.config.bytes_per_pixel, &self.config.model);
        let w = Worker::new(threads, instance, own, line, self.now);
        self.workers.insert(worker, w);
        self.instances.insert(instance, worker);
        self.ever = true;
    }

    pub(super) fn ready(&mut self, worker: WorkerKey, effects: &mut Vec<Effect>) {
        self.heard(worker);
        match self.workers.get_mut(&worker) {
            Some(w) if matches!(w.phase, Phase::Preparing { .. }) => {
                w.phase = Phase::Ready;
                self.refresh(worker);
            }
            Some(w) if w.phase == Phase::Draining => {}
            Some(_) => self.cut_off(worker, CutOff::Broke("it was ready before".into()), effects),
            None => {}
        }
    }

    pub(super) fn draining(&mut self, worker: WorkerKey, effects: &mut Vec<Effect>) {
        self.heard(worker);
        match self.workers.get_mut(&worker) {
            Some(w) if w.phase == Phase::Draining => {
                self.cut_off(worker, CutOff::Broke("it was leaving before".into()), effects);
            }
            Some(w) => {
                w.phase = Phase::Draining;
                self.refresh(worker);
            }
            None => {}
        }
    }

    pub(super) fn cut_off(&mut self, worker: WorkerKey, why: CutOff, effects: &mut Vec<Effect>) {
        if !self.workers.contains_key(&worker) {
            return;
        }
        // Breaking a rule is the worker's failure and not its tiles'.
        let cause = match &why {
            CutOff::Broke(_) => None,
            CutOff::Silent(_) | CutOff::Unready(_) => Some("the worker fell silent"),
        };
        self.gone(worker, cause, effects);
        effects.push(Effect::CutOff { worker, why });
    }

    /// Frees what a worker held. With a `cause`, it is asked whether what it was rendering is to blame.
    pub(super) fn gone(&mut self, worker: WorkerKey, cause: Option<&str>, effects: &mut Vec<Effect>) {
        let Some(w) = self.workers.get(&worker) else { return };
        let (instance, proven, running) = (w.instance, w.proven, w.running);
        let (leases, peaceful) = (w.leases.clone(), w.phase == Phase::Draining && w.leases.is_empty());
        if !leases.is_empty() {
            effects.push(Effect::Lost { worker, tiles: leases.len() as u64 });
        }
        let mut at_work = Vec::new();
        // From the back, so that the oldest is the first to be leased again.
        for (place, lease) in leases.into_iter().enumerate().rev() {
            let Some(open) = self.close(lease) else { continue };
            match self.tiles.get(&open.tile) {
                Some(tile) if cause.is_some() && place < running => {
                    at_work.push(AtWork { tile: open.tile, region: tile.region, granted: open.granted });
                }
                _ => self.release(open.tile),
            }
        }
        if let Some(w) = self.workers.remove(&worker) {
            self.uncount(&w);
        }
        if self.instances.get(&instance) == Some(&worker) {
            self.instances.remove(&instance);
        }
        if let Some(cause) = cause.filter(|_| !peaceful) {
            self.lost(Loss::new(self.now, (instance, proven), &at_work, cause), &at_work);
        }
    }

    /// Brings the sums, and the order of those with room, up to date with a worker.
    pub(super) fn refresh(&mut self, worker: WorkerKey) {
        let Some(w) = self.workers.get_mut(&worker) else { return };
        let fit = w.is_fit();
        let share = fit.then(|| Share::new(w.threads, w.proven, w.pace(), w.held));
        if w.counted != share {
            if let Some(old) = std::mem::replace(&mut w.counted, share) {
                self.crowd.remove(&old);
            }
            if let Some(new) = &share {
                self.crowd.add(new);
            }
        }
        let place = (fit && w.leases.len() < w.depth).then_some((w.leases.len(), !w.proven, worker));
        if w.place != place {
            if let Some(old) = std::mem::replace(&mut w.place, place) {
                self.room.remove(&old);
            }
            self.room.extend(place);
        }
    }

    /// Takes a worker that is gone out of the sums.
    fn uncount(&mut self, w: &Worker) {
        if let Some(share) = &w.counted {
            self.crowd.remove(share);
        }
        if let Some(place) = &w.place {
            self.room.remove(place);
        }
    }
}
