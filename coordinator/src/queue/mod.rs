//! The jobs of a farm that stays: kept on disk, chosen by whose turn it is, rendered by the farm's workers.
//!
//! One thread owns them. What it answers is on the disk before; a job that ends by a crash goes on from its journal.
//! The farm renders a few jobs at once ([`choose`]) and splits its workers between them.

mod choose;
mod engine;
mod keep;
mod load;
mod spans;
mod spec;
mod store;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use tessera_proto::SceneHash;
use tessera_proto::control::{self, Job, Spec, State};
use tokio::sync::{Semaphore, oneshot, watch};

use crate::farm::{Order, WorkerView};
use crate::film::Canvas;
use crate::progress::{Progress, WorkerStats};
pub use keep::Keep;
pub(crate) use spec::region_of;
use store::Store;
pub use store::StoreError;
pub(crate) use store::write_whole;

/// Requests that change jobs and are under way, at most.
const REQUESTS: usize = 256;

/// What hinders a farm.
const CLOSING: &str = "the farm is closing";
const UNWRITTEN: &str = "the farm could not write its state";

/// Why a job is not what was asked for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Refused {
    /// There is none of this number.
    #[error("there is no job {0}")]
    Unknown(u64),
    /// Its scene is not there.
    #[error("the job's scene is not here: send it first")]
    NoScene,
    /// What is asked for makes no sense.
    #[error("{0}")]
    Bad(String),
    /// It is in no state to be changed so.
    #[error("job {0} is {1}: it cannot be {2}")]
    State(u64, &'static str, &'static str),
    /// It is the one job of a single render.
    #[error("this is a single render: it cannot be {0}, now or at all")]
    Single(&'static str),
    /// It cannot be kept.
    #[error("the farm cannot write its state: {0}")]
    Disk(String),
    /// The farm ends.
    #[error("the farm is closing")]
    Closing,
}

/// What is asked of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Change {
    Pause,
    Resume,
    Cancel,
}

/// Where an answer goes.
type Reply<T> = oneshot::Sender<Result<T, Refused>>;

/// What the queue's thread hears.
enum Ask {
    Submit(Box<Spec>, Reply<Job>),
    Change(u64, Change, Reply<Job>),
    Fetched(u64),
    Loaded(u64, Result<Box<load::Loaded>, String>),
    Ended(u64, Box<engine::End>),
    Close(oneshot::Sender<()>),
}

/// A job as it is kept in memory.
#[derive(Clone, Debug)]
struct Entry {
    job: Job,
    /// While it is rendered.
    progress: Option<watch::Receiver<Progress>>,
    canvas: Option<Canvas>,
}

/// The queue, as those see it who ask something of it. Clones are the same queue.
#[derive(Clone)]
pub struct Queue(Arc<Inner>);

struct Inner {
    asks: Mutex<Sender<Ask>>,
    requests: Semaphore,
    jobs: Arc<Jobs>,
    store: Arc<Store>,
    views: Mutex<Option<watch::Receiver<Vec<WorkerView>>>>,
    orders: tokio::sync::mpsc::Sender<Order>,
}

/// All jobs, readable by everybody, changed by the queue's thread alone.
#[derive(Default)]
struct Jobs {
    entries: Mutex<BTreeMap<u64, Entry>>,
    /// Counts changes.
    changed: watch::Sender<u64>,
    /// Why nothing is taken now, or nothing is kept.
    trouble: watch::Sender<Option<&'static str>>,
    /// The jobs that the farm renders, by the numbers its workers know them by.
    numbers: Mutex<BTreeMap<u64, u64>>,
}

impl Jobs {
    fn entries(&self) -> MutexGuard<'_, BTreeMap<u64, Entry>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn numbers(&self) -> MutexGuard<'_, BTreeMap<u64, u64>> {
        self.numbers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Jobs {
    fn trouble(&self, now: Option<&'static str>) {
        // Once it is closing, it stays so.
        self.trouble.send_if_modified(|before| {
            let differs = *before != Some(CLOSING) && *before != now;
            if differs {
                *before = now;
            }
            differs
        });
    }
}

impl std::fmt::Debug for Queue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Queue").field("jobs", &self.0.jobs.entries().len()).finish_non_exhaustive()
    }
}

/// What a farm that stays is told to do by its queue.
pub struct Orders(pub(crate) tokio::sync::mpsc::Receiver<Order>);

impl std::fmt::Debug for Orders {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Orders").finish_non_exhaustive()
    }
}

impl Queue {
    /// The queue in `folder`, with what an earlier run left there, which goes on. Must be called inside a runtime.
    ///
    /// # Errors
    /// When the folder cannot be used, is another's, or another farm is at work on it.
    pub fn open(folder: &Path, keep: Keep) -> Result<(Self, Orders), StoreError> {
        let (store, kept) = Store::open(folder)?;
        let (orders, obeyed) = tokio::sync::mpsc::channel(64);
        let (asks, asked) = std::sync::mpsc::channel();
        let (store, jobs) = (Arc::new(store), Arc::new(Jobs::default()));
        let engine =
            engine::Engine::new((store.clone(), jobs.clone()), kept, orders.clone(), (asks.clone(), asked), keep);
        std::thread::Builder::new()
            .name("queue".into())
            .spawn(move || engine.run())
            .map_err(|e| StoreError::Io(folder.into(), e))?;
        let requests = Semaphore::new(REQUESTS);
        let inner = Inner { asks: Mutex::new(asks), requests, jobs, store, views: Mutex::default(), orders };
        Ok((Self(Arc::new(inner)), Orders(obeyed)))
    }

    async fn ask<T>(&self, ask: impl FnOnce(Reply<T>) -> Ask) -> Result<T, Refused> {
        let _permit = self.0.requests.acquire().await.map_err(|_| Refused::Closing)?;
        let (reply, answer) = oneshot::channel();
        self.send(ask(reply))?;
        answer.await.map_err(|_| Refused::Closing)?
    }

    fn send(&self, ask: Ask) -> Result<(), Refused> {
        self.0.asks.lock().unwrap_or_else(PoisonError::into_inner).send(ask).map_err(|_| Refused::Closing)
    }

    /// Why jobs are not taken and rendered now, where that is so.
    pub(crate) fn ready(&self) -> Result<(), &'static str> {
        if self.0.views.lock().unwrap_or_else(PoisonError::into_inner).is_none() {
            return Err("the farm does not serve yet");
        }
        match *self.0.jobs.trouble.borrow() {
            None => Ok(()),
            Some(why) => Err(why),
        }
    }

    /// Waits until it is being closed.
    pub(crate) async fn closing(&self) {
        let _ = self.0.jobs.trouble.subscribe().wait_for(|t| *t == Some(CLOSING)).await;
    }

    /// Queues a job; it is on the disk when this answers.
    pub(crate) async fn submit(&self, spec: Spec) -> Result<Job, Refused> {
        self.ask(|reply| Ask::Submit(Box::new(spec), reply)).await
    }

    /// Changes a job's state; it is on the disk when this answers.
    pub(crate) async fn change(&self, id: u64, change: Change) -> Result<Job, Refused> {
        self.ask(|reply| Ask::Change(id, change, reply)).await
    }

    /// A job, with how far it is.
    pub(crate) fn job(&self, id: u64) -> Result<Job, Refused> {
        let entry = self.0.jobs.entries().get(&id).cloned().ok_or(Refused::Unknown(id))?;
        Ok(shown(&entry))
    }

    /// Jobs of higher numbers than `after`, the first `most` of them.
    pub(crate) fn list(&self, after: u64, most: usize) -> Vec<Job> {
        let entries = self.0.jobs.entries();
        entries.range(after.saturating_add(1)..).take(most).map(|(_, entry)| shown(entry)).collect()
    }

    /// Counts changes of jobs; progress is not counted.
    pub(crate) fn changes(&self) -> watch::Receiver<u64> {
        self.0.jobs.changed.subscribe()
    }

    /// A job's picture, while it is rendered.
    pub(crate) fn canvas(&self, id: u64) -> Option<Canvas> {
        self.0.jobs.entries().get(&id)?.canvas.clone()
    }

    /// The newest jobs, `most` of them, in the order in which they came.
    pub(crate) fn latest(&self, most: usize) -> Vec<Job> {
        let entries = self.0.jobs.entries();
        let mut jobs: Vec<Job> = entries.values().rev().take(most).map(shown).collect();
        jobs.reverse();
        jobs
    }

    /// How many jobs there are in each state.
    pub(crate) fn counts(&self) -> BTreeMap<&'static str, u64> {
        let mut counts = BTreeMap::new();
        for entry in self.0.jobs.entries().values() {
            *counts.entry(state_name(entry.job.state())).or_default() += 1;
        }
        counts
    }

    /// How many workers there are.
    pub(crate) fn worker_count(&self) -> usize {
        let views = self.0.views.lock().unwrap_or_else(PoisonError::into_inner).clone();
        views.map_or(0, |views| views.borrow().len())
    }

    /// What there is to do.
    #[must_use]
    pub fn demand(&self) -> crate::fleet::Demand {
        let workers = self.worker_count();
        let unfinished: Vec<Job> = {
            let entries = self.0.jobs.entries();
            entries.values().filter(|entry| !is_final(entry.job.state())).map(shown).collect()
        };
        crate::fleet::demand_of_jobs(unfinished.iter(), workers)
    }

    /// The farm's workers, and the numbers of the jobs they render for.
    pub(crate) fn workers(&self) -> Vec<control::Worker> {
        let views = self.0.views.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let Some(views) = views else { return Vec::new() };
        let numbers = self.0.jobs.numbers();
        let views = views.borrow();
        let job = |v: &WorkerView| v.job.and_then(|n| numbers.get(&n.0)).copied().unwrap_or(0);
        views.iter().map(|v| worker_of(&v.stats, job(v), v.draining)).collect()
    }

    /// Has a worker leave; `false` where there is none of this name.
    pub(crate) async fn drain(&self, name: &str) -> bool {
        let there = self.workers().iter().any(|w| w.name == name);
        there && self.0.orders.send(Order::Drain(name.into())).await.is_ok()
    }

    /// Whose workers these are.
    pub(crate) fn attach(&self, views: watch::Receiver<Vec<WorkerView>>) {
        *self.0.views.lock().unwrap_or_else(PoisonError::into_inner) = Some(views);
    }

    /// Where a scene is, or would be.
    pub(crate) fn scene_path(&self, hash: SceneHash) -> PathBuf {
        self.0.store.scene(hash)
    }

    /// The pixels of a job that is done.
    pub(crate) fn pixels_path(&self, job: &Job) -> Option<PathBuf> {
        let hash = &job.result.as_ref()?.pixels_sha256;
        Some(self.0.store.pixels(hash.as_slice().try_into().ok()?))
    }

    /// The journal of a job that is not.
    pub(crate) fn journal_path(&self, id: u64) -> PathBuf {
        self.0.store.journal(id)
    }

    /// A job's picture was fetched as a whole.
    pub(crate) fn fetched(&self, id: u64) {
        let _ = self.send(Ask::Fetched(id));
    }

    /// Stops all jobs, what is done of them being kept, and waits until that is so.
    pub async fn close(&self) {
        self.0.jobs.trouble(Some(CLOSING));
        let (reply, closed) = oneshot::channel();
        if self.send(Ask::Close(reply)).is_ok() {
            let _ = closed.await;
        }
    }
}

/// A job as users see it.
fn shown(entry: &Entry) -> Job {
    let mut job = entry.job.clone();
    job.progress = entry.progress.as_ref().map(|p| Box::new(progress(&p.borrow())));
    job
}

/// Progress as users see it.
pub(crate) fn progress(p: &Progress) -> control::Progress {
    control::Progress {
        share: p.share,
        pass: p.pass,
        is_look: p.is_look,
        tiles_done: p.tiles_done,
        tiles_total: p.tiles_total,
        pixels_done: p.pixels_done,
        pixels_total: p.pixels_total,
        rays: Some(p.rays.into()),
        elapsed_us: micros(p.elapsed),
        remaining_us: p.remaining.map(micros),
        workers: p.workers.iter().filter(|w| w.connected).count() as u32,
        error: p.error,
    }
}

/// A worker as users see it, and for which job it renders; 0 for none.
pub(crate) fn worker_of(s: &WorkerStats, job: u64, draining: bool) -> control::Worker {
    control::Worker {
        name: s.name.clone(),
        address: s.address.clone(),
        threads: s.threads,
        job,
        draining,
        tiles: s.tiles,
        pixels: s.pixels,
        rays: s.rays.total(),
        busy_us: micros(s.busy),
        lost: s.lost,
        verified: s.verified,
    }
}

fn micros(d: std::time::Duration) -> u64 {
    u64::try_from(d.as_micros()).unwrap_or(u64::MAX)
}

/// Milliseconds since 1970.
pub(crate) fn now_ms() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| u64::try_from(d.as_millis()).unwrap_or(u64::MAX))
}

/// A state in a user's words.
#[must_use]
pub fn state_name(state: State) -> &'static str {
    match state {
        State::Unspecified => "unknown",
        State::Queued => "queued",
        State::Rendering => "rendering",
        State::Paused => "paused",
        State::Done => "done",
        State::Failed => "failed",
        State::Cancelled => "cancelled",
    }
}

/// Whether nothing more becomes of a job by itself.
#[must_use]
pub fn is_final(state: State) -> bool {
    matches!(state, State::Done | State::Failed | State::Cancelled)
}
