//! Who renders for which job.

use tessera_proto::JobNumber;
use tessera_proto::convert::Job;
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{self, CoordinatorMessage};
use tokio::time::Instant;

use super::{Active, Dispatcher, SHARE_EVERY, Seat};
use crate::farm::run::Comer;
use crate::farm::shares::{Claim, Hand};
use crate::scheduler::WorkerKey;

impl Dispatcher {
    /// Gives workers to jobs, where that makes the split better.
    pub(super) async fn share(&mut self) {
        let now = Instant::now();
        let passed = now - self.shared;
        (self.shared, self.share_at) = (now, now + SHARE_EVERY);
        let claims: Vec<Claim> = self
            .runs
            .iter()
            .filter(|(_, active)| !active.run.is_over())
            .map(|(&job, Active { run, standing, .. })| Claim {
                job,
                owner: standing.owner.clone(),
                rank: standing.rank,
                wants: run.wants(),
            })
            .collect();
        let hands: Vec<Hand> = self.seats.iter().filter(|(_, s)| !s.draining).map(|(&w, s)| self.hand(w, s)).collect();
        for (worker, job) in self.shares.split(&claims, &hands, passed) {
            self.give(worker, job).await;
        }
        self.watch_silence(now).await;
        self.show();
    }

    fn hand(&self, worker: WorkerKey, seat: &Seat) -> Hand {
        let still_with = self.runs.iter().filter(|(n, a)| seat.job != Some(**n) && a.run.has(worker)).map(|(&n, _)| n);
        Hand {
            worker,
            threads: u64::from(seat.threads),
            job: seat.job,
            idle: seat.job.and_then(|n| self.runs.get(&n)).is_none_or(|a| a.run.is_idle(worker)),
            barred: seat.unable.iter().copied().chain(still_with).collect(),
        }
    }

    /// Gives a worker to a job.
    async fn give(&mut self, worker: WorkerKey, number: JobNumber) {
        let Some(before) = self.seats.get(&worker).map(|s| s.job) else { return };
        if let Some(active) = before.and_then(|n| self.runs.get_mut(&n)) {
            active.run.release(worker).await;
        }
        if let Some(before) = before {
            self.noted(before).await;
        }
        let Some(seat) = self.seats.get_mut(&worker) else { return };
        (seat.job, seat.told) = (Some(number), false);
        let comer = Comer {
            id: seat.id,
            instance: seat.instance,
            name: seat.name.clone(),
            address: seat.address.clone(),
            threads: seat.threads,
            own: seat.own,
            mouth: seat.mouth.clone(),
            cut: seat.cut.clone(),
            pulse: seat.pulse.clone(),
        };
        if let Some(active) = self.runs.get_mut(&number) {
            active.run.join(worker, comer).await;
        }
        self.tell_job(number);
        self.noted(number).await;
    }

    /// Tells the workers of a job what to render, as soon as its scene can be named.
    pub(super) fn tell_job(&mut self, number: JobNumber) {
        let Some(offer) = self.door.offered(number) else { return };
        let trace = self.runs.get(&number).and_then(|active| active.run.trace());
        let traceparent = trace.map_or_else(String::new, |context| context.to_string());
        for seat in self.seats.values_mut().filter(|s| s.job == Some(number) && !s.told) {
            let scene = if seat.own { None } else { offer.scene_name() };
            if scene.is_none() && !seat.own {
                self.door.describe(number);
                continue;
            }
            let job = Job { number, scene, settings: offer.settings, pixels: offer.pixels };
            let job = wire::Job { traceparent: traceparent.clone(), ..job.into() };
            let message = CoordinatorMessage { kind: Some(Kind::Job(job)) };
            if seat.mouth.try_send(Ok(message)).is_err() {
                seat.cut.cancel();
            }
            seat.told = true;
        }
    }
}
