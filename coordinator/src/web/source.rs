//! What a page shows: the jobs of a farm that stays, or the one of a single render.

use std::collections::BTreeMap;

use tessera_proto::control::{Job, State, Worker};

use crate::film::Canvas;
use crate::journal::Partial;
use crate::queue::{Change, Queue, Refused};

/// See the [module](self).
#[tonic::async_trait]
pub(crate) trait Source: Send + Sync + 'static {
    /// Why nothing is rendered now, where that is so.
    fn ready(&self) -> Result<(), &'static str>;
    /// A job, with how far it is.
    fn job(&self, id: u64) -> Result<Job, Refused>;
    /// Jobs of higher numbers than `after`, the first `most` of them.
    fn list(&self, after: u64, most: usize) -> Vec<Job>;
    /// The newest jobs, `most` of them, in the order in which they came.
    fn latest(&self, most: usize) -> Vec<Job>;
    /// How many jobs there are in each state.
    fn counts(&self) -> BTreeMap<&'static str, u64>;
    /// Counts changes of jobs; progress is not counted.
    fn changes(&self) -> u64;
    /// A job's picture, while it is rendered.
    fn canvas(&self, id: u64) -> Option<Canvas>;
    /// Where the pixels of a job that is done are stored.
    fn stored(&self, job: &Job) -> Option<std::path::PathBuf>;
    /// What is kept of a job that is neither rendered now nor done.
    fn partial(&self, id: u64) -> Option<Partial>;
    /// The workers, and the numbers of the jobs they render for.
    fn workers(&self) -> Vec<Worker>;
    /// How many workers there are.
    fn worker_count(&self) -> usize;
    /// The changes that a job in this state can undergo, as the interface calls them.
    fn actions(&self, state: State) -> &'static [&'static str];
    /// Whether workers can be told to leave.
    fn can_drain(&self) -> bool;
    /// Changes a job's state.
    async fn change(&self, id: u64, change: Change) -> Result<Job, Refused>;
    /// Has a worker leave; `false` where there is none of this name.
    async fn drain(&self, name: &str) -> bool;
}

#[tonic::async_trait]
impl Source for Queue {
    fn ready(&self) -> Result<(), &'static str> {
        self.ready()
    }

    fn job(&self, id: u64) -> Result<Job, Refused> {
        self.job(id)
    }

    fn list(&self, after: u64, most: usize) -> Vec<Job> {
        self.list(after, most)
    }

    fn latest(&self, most: usize) -> Vec<Job> {
        self.latest(most)
    }

    fn counts(&self) -> BTreeMap<&'static str, u64> {
        self.counts()
    }

    fn changes(&self) -> u64 {
        *self.changes().borrow()
    }

    fn canvas(&self, id: u64) -> Option<Canvas> {
        self.canvas(id)
    }

    fn stored(&self, job: &Job) -> Option<std::path::PathBuf> {
        self.pixels_path(job)
    }

    fn partial(&self, id: u64) -> Option<Partial> {
        Partial::read(&self.journal_path(id)).ok()
    }

    fn workers(&self) -> Vec<Worker> {
        self.workers()
    }

    fn worker_count(&self) -> usize {
        self.worker_count()
    }

    fn actions(&self, state: State) -> &'static [&'static str] {
        match state {
            State::Queued | State::Rendering => &["pause", "cancel"],
            State::Paused => &["resume", "cancel"],
            State::Failed => &["resume"],
            State::Unspecified | State::Done | State::Cancelled => &[],
        }
    }

    fn can_drain(&self) -> bool {
        true
    }

    async fn change(&self, id: u64, change: Change) -> Result<Job, Refused> {
        self.change(id, change).await
    }

    async fn drain(&self, name: &str) -> bool {
        self.drain(name).await
    }
}
