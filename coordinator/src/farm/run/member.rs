//! Workers that render for a job, and what others have to know of them.

use std::time::Duration;

use tessera_core::trace::RayCounts;
use tessera_proto::convert::Lease;
use tessera_proto::identity::WorkerId;
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{self, CoordinatorMessage};
use tessera_proto::{InstanceId, TraceContext};
use tokio_util::sync::CancellationToken;
use tonic::Status;

use super::figures::name;
use super::{LIVENESS_EVERY, Run};
use crate::farm::guard::for_good;
use crate::farm::liveness::LastSign;
use crate::farm::service::Outbox;
use crate::job::RenderJob;
use crate::journal::{Found, Head, Sink};
use crate::scheduler::{CutOff, Effect, Event, WorkerKey};

/// A worker that renders for this job.
pub(super) struct Member {
    pub(super) outbox: Outbox,
    pub(super) cut: CancellationToken,
    pub(super) id: WorkerId,
    /// Whether it may render.
    pub(super) ready: bool,
    /// Whether it goes to another job as soon as it has answered what it has begun.
    pub(super) leaving: bool,
    /// Location of its figures in [`Progress::workers`].
    pub(super) place: usize,
    pub(super) threads: u32,
    pub(super) last_sign: LastSign,
    /// Its last sign of life when it was last looked at.
    pub(super) felt: u64,
    /// Tiles that it left unanswered.
    pub(super) lost: u64,
}

/// A worker that comes to a job.
#[derive(Clone, Debug)]
pub(in crate::farm) struct Comer {
    pub(in crate::farm) id: WorkerId,
    pub(in crate::farm) instance: InstanceId,
    /// The name it is shown under.
    pub(in crate::farm) name: String,
    pub(in crate::farm) address: String,
    pub(in crate::farm) threads: u32,
    /// Whether it is one of this process.
    pub(in crate::farm) own: bool,
    pub(in crate::farm) outbox: Outbox,
    pub(in crate::farm) cut: CancellationToken,
    pub(in crate::farm) last_sign: LastSign,
}

/// What the dispatcher has to know of what happened in a job.
#[derive(Debug)]
pub(in crate::farm) enum Note {
    /// A worker's session was ended, for this cause; so many of its tiles went to others.
    CutOff { worker: WorkerKey, why: CutOff, cause: String, lost: u64 },
    /// A worker is not to come back, for this rule.
    Ban { id: WorkerId, rule: String },
    /// A tile of it went into the picture.
    Counted { worker: WorkerKey, pixels: u64, rays: RayCounts, busy: Duration },
    /// Tiles that it was given and did not deliver.
    Lost { worker: WorkerKey, tiles: u64 },
    /// A tile of it was rendered again elsewhere and is the same.
    Verified { id: WorkerId },
}

/// Ends a worker's session, telling it why; gives what it is told.
pub(in crate::farm) fn end_session(outbox: &Outbox, cut: &CancellationToken, why: &CutOff) -> String {
    let status = match why {
        // It would be turned away if it dialled again.
        CutOff::Broke(rule) => for_good(Status::invalid_argument(format!("this worker was cut off: {rule}"))),
        CutOff::Silent(time) => Status::deadline_exceeded(format!("nothing was heard for {time:.1?}")),
        CutOff::Unready(time) => Status::deadline_exceeded(format!("the scene was not ready after {time:.0?}")),
    };
    let cause = status.message().to_owned();
    let _ = outbox.try_send(Err(status));
    cut.cancel();
    cause
}

/// Starts the job's journal, if it has one, and gives what an earlier run left in it.
pub(super) fn keep(job: &RenderJob) -> (Option<Sink>, Option<Found>) {
    let Some(journal) = &job.journal else { return (None, None) };
    let (scene, goal, verified) = (job.scene.scene().clone(), job.goal, job.verify > 0.0);
    let (settings, region, pixels) = (job.settings, job.region, job.pixels);
    journal.start(move || Head::new(&scene, settings, region, pixels, goal).verified(verified))
}

impl Run {
    /// Tells the scheduler now and then of whom something was heard since, and lets the clock run on.
    pub(super) fn check_liveness(&mut self, now: Duration, effects: &mut Vec<Effect>) {
        if now < self.pulse_at {
            return;
        }
        self.pulse_at = now + LIVENESS_EVERY;
        for (&worker, member) in &mut self.members {
            let last = member.last_sign.last();
            if std::mem::replace(&mut member.felt, last) != last {
                self.scheduler.handle(Event::Heard { worker }, now, effects);
            }
        }
        self.progress.send_modify(|p| p.elapsed = now);
    }

    /// Leases a tile.
    pub(super) fn lease(&mut self, worker: WorkerKey, wire: wire::Lease, lease: &Lease) {
        let name = || name(&self.progress, &self.members, worker);
        let span = self.spans.granted(lease, worker, name);
        self.say(worker, Kind::Lease(wire::Lease { span, ..wire }));
    }

    /// What workers hang their spans of this job under.
    pub(in crate::farm) fn trace(&self) -> Option<TraceContext> {
        self.spans.context()
    }

    pub(super) fn say(&mut self, worker: WorkerKey, kind: Kind) {
        let Some(member) = self.members.get(&worker) else { return };
        let message = CoordinatorMessage { kind: Some(kind) };
        if member.outbox.try_send(Ok(message)).is_err() {
            // It does not read: ending its stream makes it leave.
            member.cut.cancel();
        }
    }

    pub(super) fn cut_off(&mut self, worker: WorkerKey, why: CutOff) {
        let Some(member) = self.members.get(&worker) else { return };
        let cause = end_session(&member.outbox, &member.cut, &why);
        let lost = self.remove(worker, &cause);
        self.notes.push(Note::CutOff { worker, why, cause, lost });
    }

    pub(super) fn remove(&mut self, worker: WorkerKey, cause: &str) -> u64 {
        self.figures(worker, |w| {
            w.connected = false;
            w.holds = 0;
            w.left = Some(cause.into());
        });
        self.last_cause = Some(format!("{}: {cause}", self.name(worker)));
        self.spans.lost(worker);
        let Some(member) = self.members.remove(&worker) else { return 0 };
        self.roster.left(member.id);
        self.reassign(worker, member.id);
        member.lost
    }
}
