//! Who renders for which job.

use tessera_proto::JobNumber;
use tessera_proto::convert::Job;
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{self, CoordinatorMessage};
use tokio::time::Instant;

use super::{Active, Dispatcher, SHARE_EVERY, Session};
use crate::farm::run::Comer;
use crate::farm::shares::{Claim, Hand};
use crate::scheduler::WorkerKey;

impl Dispatcher {
    /// Gives workers to jobs, where that makes the split better.
    pub(super) async fn share(&mut self) {
        let now = Instant::now();
        let passed = now - self.allotted;
        (self.allotted, self.share_at) = (now, now + SHARE_EVERY);
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
        let hands: Vec<Hand> =
            self.sessions.iter().filter(|(_, s)| !s.draining).map(|(&w, s)| self.hand(w, s)).collect();
        for (worker, job) in self.shares.split(&claims, &hands, passed) {
            self.give(worker, job).await;
        }
        self.watch_silence(now).await;
        self.show();
    }

    fn hand(&self, worker: WorkerKey, session: &Session) -> Hand {
        let still_with =
            self.runs.iter().filter(|(n, a)| session.job != Some(**n) && a.run.has(worker)).map(|(&n, _)| n);
        Hand {
            worker,
            threads: u64::from(session.threads),
            job: session.job,
            idle: session.job.and_then(|n| self.runs.get(&n)).is_none_or(|a| a.run.is_idle(worker)),
            barred: session.unable.iter().copied().chain(still_with).collect(),
        }
    }

    /// Gives a worker to a job.
    async fn give(&mut self, worker: WorkerKey, number: JobNumber) {
        let Some(before) = self.sessions.get(&worker).map(|s| s.job) else { return };
        if let Some(active) = before.and_then(|n| self.runs.get_mut(&n)) {
            active.run.release(worker).await;
        }
        if let Some(before) = before {
            self.noted(before).await;
        }
        let Some(session) = self.sessions.get_mut(&worker) else { return };
        (session.job, session.told) = (Some(number), false);
        let comer = Comer {
            id: session.id,
            instance: session.instance,
            name: session.name.clone(),
            address: session.address.clone(),
            threads: session.threads,
            own: session.own,
            outbox: session.outbox.clone(),
            cut: session.cut.clone(),
            last_sign: session.last_sign.clone(),
        };
        if let Some(active) = self.runs.get_mut(&number) {
            active.run.join(worker, comer).await;
        }
        self.tell_job(number);
        self.noted(number).await;
    }

    /// Tells the workers of a job what to render, as soon as its scene can be named.
    pub(super) fn tell_job(&mut self, number: JobNumber) {
        let Some(offer) = self.shared.offered(number) else { return };
        let trace = self.runs.get(&number).and_then(|active| active.run.trace());
        let traceparent = trace.map_or_else(String::new, |context| context.to_string());
        for session in self.sessions.values_mut().filter(|s| s.job == Some(number) && !s.told) {
            let scene = if session.own { None } else { offer.scene_name() };
            if scene.is_none() && !session.own {
                self.shared.describe(number);
                continue;
            }
            let job = Job { number, scene, settings: offer.settings, pixels: offer.pixels };
            let job = wire::Job { traceparent: traceparent.clone(), ..job.into() };
            let message = CoordinatorMessage { kind: Some(Kind::Job(job)) };
            if session.outbox.try_send(Ok(message)).is_err() {
                session.cut.cancel();
            }
            session.told = true;
        }
    }
}
