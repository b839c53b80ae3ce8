//! Workers that render for a job, and what others have to know of them.

use std::time::Duration;

use tessera_core::trace::RayCounts;
use tessera_proto::InstanceId;
use tessera_proto::identity::WorkerId;
use tokio_util::sync::CancellationToken;
use tonic::Status;

use crate::farm::guard::for_good;
use crate::farm::pulse::Pulse;
use crate::farm::service::Mouth;
use crate::job::RenderJob;
use crate::journal::{Found, Head, Sink};
use crate::scheduler::{CutOff, WorkerKey};

/// A worker that renders for this job.
pub(super) struct Member {
    pub(super) mouth: Mouth,
    pub(super) cut: CancellationToken,
    pub(super) id: WorkerId,
    /// Whether it may render.
    pub(super) ready: bool,
    /// Whether it goes to another job as soon as it has answered what it has begun.
    pub(super) leaving: bool,
    /// Place of its figures in [`Progress::workers`].
    pub(super) place: usize,
    pub(super) threads: u32,
    pub(super) pulse: Pulse,
    /// Its pulse when it was last looked at.
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
    pub(in crate::farm) mouth: Mouth,
    pub(in crate::farm) cut: CancellationToken,
    pub(in crate::farm) pulse: Pulse,
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
pub(in crate::farm) fn end_session(mouth: &Mouth, cut: &CancellationToken, why: &CutOff) -> String {
    let status = match why {
        // It would be turned away if it dialled again.
        CutOff::Broke(rule) => for_good(Status::invalid_argument(format!("this worker was cut off: {rule}"))),
        CutOff::Silent(time) => Status::deadline_exceeded(format!("nothing was heard for {time:.1?}")),
        CutOff::Unready(time) => Status::deadline_exceeded(format!("the scene was not ready after {time:.0?}")),
    };
    let cause = status.message().to_owned();
    let _ = mouth.try_send(Err(status));
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
