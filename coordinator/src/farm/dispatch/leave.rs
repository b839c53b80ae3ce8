//! Workers leave, are told to, or are sent away.

use std::sync::PoisonError;
use std::time::Duration;

use tessera_proto::JobNumber;
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{CoordinatorMessage, Finished};
use tokio::time::{Instant, timeout_at};
use tonic::Status;

use super::{Dispatcher, FARM, Seat};
use crate::farm::run::end_session;
use crate::farm::service::{BROKE, Heard, IN_PEACE, Said};
use crate::scheduler::{CutOff, WorkerKey};

/// How long workers are given to hear that there is no more work.
const GOODBYE_WITHIN: Duration = Duration::from_millis(250);

impl Dispatcher {
    /// Ends sessions of workers of no job that fell silent; a job watches its own.
    pub(super) async fn watch_silence(&mut self, now: Instant) {
        let mut silent = Vec::new();
        for (&worker, seat) in self.seats.iter_mut() {
            let last = seat.pulse.last();
            if last != seat.felt.0 || seat.job.is_some() {
                seat.felt = (last, now);
            } else if now - seat.felt.1 >= self.timing.dead_after {
                silent.push((worker, now - seat.felt.1));
            }
        }
        for (worker, time) in silent {
            self.cut_off(worker, CutOff::Silent(time)).await;
        }
    }

    /// A worker will leave: it gets no more.
    pub(super) async fn drains(&mut self, worker: WorkerKey) {
        let Some(seat) = self.seats.get_mut(&worker) else { return };
        if std::mem::replace(&mut seat.draining, true) {
            return self.cut_off(worker, CutOff::Broke("it was leaving before".into())).await;
        }
        let numbers: Vec<JobNumber> = self.runs.keys().copied().collect();
        for number in numbers {
            if self.seats.get(&worker).and_then(|s| s.job) == Some(number) {
                self.pass_on(number, worker, Said::Draining).await;
            }
        }
    }

    /// Has a worker leave in order: it renders what it has begun, and is then told that there is no more.
    pub(super) async fn retire(&mut self, worker: WorkerKey) {
        let Some(seat) = self.seats.get_mut(&worker) else { return };
        (seat.draining, seat.retired) = (true, true);
        let job = seat.job.take();
        if let Some(active) = job.and_then(|n| self.runs.get_mut(&n)) {
            active.run.release(worker).await;
        }
        if let Some(number) = job {
            self.noted(number).await;
        }
        self.dismiss_retired(worker);
    }

    pub(super) fn dismiss_retired(&mut self, worker: WorkerKey) {
        if self.runs.values().any(|a| a.run.has(worker)) {
            return;
        }
        if let Some(seat) = self.seats.get(&worker) {
            let bye = CoordinatorMessage { kind: Some(Kind::Finished(Finished { leave: true })) };
            let _ = seat.mouth.try_send(Ok(bye));
        }
    }

    pub(super) async fn cut_off(&mut self, worker: WorkerKey, why: CutOff) {
        let Some(seat) = self.seats.get(&worker) else { return };
        if let CutOff::Broke(rule) = &why {
            self.roster.ban(seat.id, rule.clone());
            // Breaking a rule is not the fault of what it was rendering.
            let number = seat.job.filter(|n| self.is_with(*n, worker));
            if let Some(number) = number {
                return Box::pin(self.pass_on(number, worker, Said::Nonsense(rule.clone()))).await;
            }
        }
        let cause = end_session(&seat.mouth, &seat.cut, &why);
        Box::pin(self.unseat(worker, &cause)).await;
    }

    pub(super) async fn left(&mut self, worker: WorkerKey, cause: &str) {
        self.unseat(worker, cause).await;
    }

    /// A worker is gone.
    pub(super) async fn unseat(&mut self, worker: WorkerKey, cause: &str) {
        let Some(seat) = self.seats.remove(&worker) else { return };
        self.door.sessions.lock().unwrap_or_else(PoisonError::into_inner).remove(&seat.session);
        seat.cut.cancel();
        self.roster.left(seat.id);
        // What lies beneath is for whoever asks for it.
        let (raw, cause) = (cause, if cause.starts_with(BROKE) { "connection lost" } else { cause });
        let mut lost = seat.lost;
        let numbers: Vec<JobNumber> = self.runs.keys().copied().collect();
        for number in numbers {
            if let Some(active) = self.runs.get_mut(&number) {
                lost += active.run.left(worker, cause.into()).await;
            }
            Box::pin(self.noted(number)).await;
        }
        say_left(&seat, lost, raw);
        if let Some(w) = self.figures.get_mut(seat.place) {
            (w.connected, w.holds, w.left) = (false, 0, Some(cause.into()));
        }
        self.show();
    }

    /// Tells everyone that there is no more work, and waits a little for them to hear it; `hurry`: hardly.
    pub(super) async fn dismiss(&mut self, hurry: bool) {
        self.seats.retain(|_, seat| {
            let bye = CoordinatorMessage { kind: Some(Kind::Finished(Finished { leave: false })) };
            seat.mouth.try_send(Ok(bye)).is_ok()
        });
        let mut waiting: Vec<WorkerKey> = self.seats.keys().copied().collect();
        // A worker leaves when it has heard; its stream must stay open until then.
        // Nobody waits for tiles that come too late.
        let deadline = Instant::now() + if hurry { Duration::from_millis(10) } else { GOODBYE_WITHIN };
        while !waiting.is_empty() {
            match timeout_at(deadline, self.heard.recv()).await {
                Ok(Some(Heard::Left { worker, .. })) => waiting.retain(|w| *w != worker),
                Ok(Some(Heard::Joined(late))) => {
                    let _ = late.reply.send(Err(Status::unavailable("the render is over")));
                }
                Ok(Some(Heard::Said { .. } | Heard::Decided { .. } | Heard::Described(_))) => {}
                Ok(None) | Err(_) => break,
            }
        }
        for seat in self.seats.values() {
            seat.cut.cancel();
        }
    }
}

/// Says that a worker left, in the farm's words; what lies beneath only to whoever asks for it.
fn say_left(seat: &Seat, lost: u64, cause: &str) {
    let name = &seat.name;
    let lost = match lost {
        0 => String::new(),
        1 => "; 1 tile given to others".into(),
        n => format!("; {n} tiles given to others"),
    };
    if cause == IN_PEACE && seat.own {
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
