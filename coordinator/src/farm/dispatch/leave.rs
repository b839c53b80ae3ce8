//! Workers leave, are told to, or are sent away.

use std::sync::PoisonError;
use std::time::Duration;

use tessera_proto::JobNumber;
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{CoordinatorMessage, Finished};
use tokio::time::{Instant, timeout_at};
use tonic::Status;

use super::{Dispatcher, FARM, Session};
use crate::farm::run::end_session;
use crate::farm::service::{BROKE, FarmEvent, IN_PEACE, WorkerEvent};
use crate::scheduler::{CutOff, WorkerKey};

/// How long workers are given to hear that there is no more work.
const GOODBYE_WITHIN: Duration = Duration::from_millis(250);

impl Dispatcher {
    /// Ends sessions of workers of no job that fell silent; a job watches its own.
    pub(super) async fn watch_silence(&mut self, now: Instant) {
        let mut silent = Vec::new();
        for (&worker, session) in self.sessions.iter_mut() {
            let last = session.last_sign.last();
            if last != session.felt.0 || session.job.is_some() {
                session.felt = (last, now);
            } else if now - session.felt.1 >= self.timing.dead_after {
                silent.push((worker, now - session.felt.1));
            }
        }
        for (worker, time) in silent {
            self.cut_off(worker, CutOff::Silent(time)).await;
        }
    }

    /// A worker will leave: it gets no more.
    pub(super) async fn drains(&mut self, worker: WorkerKey) {
        let Some(session) = self.sessions.get_mut(&worker) else { return };
        if std::mem::replace(&mut session.draining, true) {
            return self.cut_off(worker, CutOff::Broke("it was leaving before".into())).await;
        }
        let numbers: Vec<JobNumber> = self.runs.keys().copied().collect();
        for number in numbers {
            if self.sessions.get(&worker).and_then(|s| s.job) == Some(number) {
                self.pass_on(number, worker, WorkerEvent::Draining).await;
            }
        }
    }

    /// Has a worker leave in order: it renders what it has begun, and is then told that there is no more.
    pub(super) async fn retire(&mut self, worker: WorkerKey) {
        let Some(session) = self.sessions.get_mut(&worker) else { return };
        (session.draining, session.retired) = (true, true);
        let job = session.job.take();
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
        if let Some(session) = self.sessions.get(&worker) {
            let bye = CoordinatorMessage { kind: Some(Kind::Finished(Finished { leave: true })) };
            let _ = session.outbox.try_send(Ok(bye));
        }
    }

    pub(super) async fn cut_off(&mut self, worker: WorkerKey, why: CutOff) {
        let Some(session) = self.sessions.get(&worker) else { return };
        if let CutOff::Broke(rule) = &why {
            self.roster.ban(session.id, rule.clone());
            // Breaking a rule is not the fault of what it was rendering.
            let number = session.job.filter(|n| self.is_with(*n, worker));
            if let Some(number) = number {
                return Box::pin(self.pass_on(number, worker, WorkerEvent::Nonsense(rule.clone()))).await;
            }
        }
        let cause = end_session(&session.outbox, &session.cut, &why);
        Box::pin(self.end_session_of(worker, &cause)).await;
    }

    pub(super) async fn left(&mut self, worker: WorkerKey, cause: &str) {
        self.end_session_of(worker, cause).await;
    }

    /// A worker is gone.
    pub(super) async fn end_session_of(&mut self, worker: WorkerKey, cause: &str) {
        let Some(session) = self.sessions.remove(&worker) else { return };
        self.shared.sessions.lock().unwrap_or_else(PoisonError::into_inner).remove(&session.session_id);
        session.cut.cancel();
        self.roster.left(session.id);
        // What lies beneath is for whoever asks for it.
        let (raw, cause) = (cause, if cause.starts_with(BROKE) { "connection lost" } else { cause });
        let mut lost = session.lost;
        let numbers: Vec<JobNumber> = self.runs.keys().copied().collect();
        for number in numbers {
            if let Some(active) = self.runs.get_mut(&number) {
                lost += active.run.left(worker, cause.into()).await;
            }
            Box::pin(self.noted(number)).await;
        }
        say_left(&session, lost, raw);
        if let Some(w) = self.figures.get_mut(session.place) {
            (w.connected, w.holds, w.left) = (false, 0, Some(cause.into()));
        }
        self.show();
    }

    /// Tells everyone that there is no more work, and waits a little for them to hear it; `hurry`: hardly.
    pub(super) async fn dismiss(&mut self, hurry: bool) {
        self.sessions.retain(|_, session| {
            let bye = CoordinatorMessage { kind: Some(Kind::Finished(Finished { leave: false })) };
            session.outbox.try_send(Ok(bye)).is_ok()
        });
        let mut waiting: Vec<WorkerKey> = self.sessions.keys().copied().collect();
        // A worker leaves when it has heard; its stream must stay open until then.
        // Nobody waits for tiles that come too late.
        let deadline = Instant::now() + if hurry { Duration::from_millis(10) } else { GOODBYE_WITHIN };
        while !waiting.is_empty() {
            match timeout_at(deadline, self.heard.recv()).await {
                Ok(Some(FarmEvent::Left { worker, .. })) => waiting.retain(|w| *w != worker),
                Ok(Some(FarmEvent::Joined(late))) => {
                    let _ = late.reply.send(Err(Status::unavailable("the render is over")));
                }
                Ok(Some(FarmEvent::Said { .. } | FarmEvent::Decided { .. } | FarmEvent::Described(_))) => {}
                Ok(None) | Err(_) => break,
            }
        }
        for session in self.sessions.values() {
            session.cut.cancel();
        }
    }
}

/// Says that a worker left, in the farm's words; what lies beneath only to whoever asks for it.
fn say_left(session: &Session, lost: u64, cause: &str) {
    let name = &session.name;
    let lost = match lost {
        0 => String::new(),
        1 => "; 1 tile given to others".into(),
        n => format!("; {n} tiles given to others"),
    };
    if cause == IN_PEACE && session.own {
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
