//! The one task that knows all workers: it admits them, gives them to jobs, and tells the jobs what they said.

mod admit;
mod assign;
mod leave;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use tessera_core::trace::RayCounts;
use tessera_proto::identity::WorkerId;
use tessera_proto::wire::coordinator_message::Kind;
use tessera_proto::wire::{CoordinatorMessage, Forget};
use tessera_proto::{InstanceId, JobNumber, LeaseId, SceneHash, SessionId};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;

use super::HEARD;
use super::liveness::LastSign;
use super::roster::Roster;
use super::run::{Finished as FinishedRun, Note, Run};
use super::service::{FarmEvent, Offer, Outbox, Shared, WorkerEvent};
use super::shares::Shares;
use crate::config::Timing;
use crate::error::RenderError;
use crate::job::RenderJob;
use crate::progress::{Progress, WorkerStats};
use crate::scheduler::{CutOff, WorkerKey};

/// Between two looks at who should render for whom, where nothing calls for one.
const SHARE_EVERY: Duration = Duration::from_millis(250);
/// What comes and goes is said under this name, also where nothing else is.
pub(crate) const FARM: &str = "farm";

/// A worker that is connected.
struct Session {
    session_id: SessionId,
    outbox: Outbox,
    cut: CancellationToken,
    id: WorkerId,
    instance: InstanceId,
    name: String,
    address: String,
    threads: u32,
    /// Whether it is one of this process.
    own: bool,
    last_sign: LastSign,
    /// Its last sign of life when it was last looked at, and when that changed.
    felt: (u64, Instant),
    /// Whether it will leave, and whether that is since it was told to.
    draining: bool,
    retired: bool,
    /// The job it renders for, and whether it was told so.
    job: Option<JobNumber>,
    told: bool,
    /// Jobs that it cannot render.
    unable: BTreeSet<JobNumber>,
    /// Its place in the farm's figures.
    place: usize,
    /// Tiles of it that went to others, by jobs that it is not with any more.
    lost: u64,
}

/// How a job counts among others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Standing {
    /// Whose it is.
    pub(crate) owner: String,
    /// Of an owner's jobs, the least comes first.
    pub(crate) rank: (i64, u64),
}

/// What a farm that stays is asked to do.
pub(crate) enum Order {
    /// Render this.
    Start {
        number: JobNumber,
        job: Box<RenderJob>,
        standing: Standing,
        progress: watch::Sender<Progress>,
        /// Hash and length of the scene's binary form.
        scene: (SceneHash, u64),
        end: oneshot::Sender<FinishedRun>,
    },
    /// Render it no more: what is done is kept.
    Stop(JobNumber),
    /// Have a worker leave in order.
    Drain(String),
    /// No job that is kept shows this scene.
    Forget(SceneHash),
}

/// A worker as the farm's users see it.
#[derive(Clone, Debug, Default)]
pub(crate) struct WorkerView {
    pub(crate) stats: WorkerStats,
    /// The job it renders for.
    pub(crate) job: Option<JobNumber>,
    pub(crate) draining: bool,
}

/// See the [module](self).
pub(super) struct Dispatcher {
    shared: Arc<Shared>,
    heard: mpsc::Receiver<FarmEvent>,
    timing: Timing,
    /// Workers of this process that will come.
    hired: usize,
    runs: BTreeMap<JobNumber, Active>,
    sessions: BTreeMap<WorkerKey, Session>,
    roster: Roster,
    figures: Vec<WorkerStats>,
    shares: Shares,
    allotted: Instant,
    share_at: Instant,
    next_worker: u64,
    views: watch::Sender<Vec<WorkerView>>,
}

/// A job that is being rendered.
struct Active {
    run: Run,
    standing: Standing,
    /// Who waits for its end.
    end: Option<oneshot::Sender<FinishedRun>>,
}

impl Dispatcher {
    pub(super) fn new(shared: Arc<Shared>, heard: mpsc::Receiver<FarmEvent>, timing: Timing, hired: usize) -> Self {
        let now = Instant::now();
        Self {
            shared,
            heard,
            timing,
            hired,
            runs: BTreeMap::new(),
            sessions: BTreeMap::new(),
            roster: Roster::default(),
            figures: Vec::new(),
            shares: Shares::default(),
            allotted: now,
            share_at: now,
            next_worker: 0,
            views: watch::channel(Vec::new()).0,
        }
    }

    /// The farm's workers, as they are.
    pub(super) fn views(&self) -> watch::Receiver<Vec<WorkerView>> {
        self.views.subscribe()
    }

    /// Renders one job to its end, and dismisses the workers.
    pub(super) async fn render_one(
        mut self,
        job: RenderJob,
        progress: watch::Sender<Progress>,
        cancel: CancellationToken,
    ) -> Result<FinishedRun, RenderError> {
        let number = JobNumber(0);
        self.start(number, job, Standing::default(), (progress, None)).await?;
        while self.runs.get(&number).is_some_and(|active| !active.run.is_over()) {
            if !self.step(&cancel, None).await {
                break;
            }
        }
        let active = self.runs.remove(&number).ok_or_else(|| RenderError::Internal("the job is gone".into()))?;
        let timed_out = active.run.timed_out();
        let finished = active.run.finish(RenderError::Cancelled);
        self.dismiss(timed_out).await;
        Ok(finished)
    }

    /// Renders what is ordered until `cancel`; then every job is ended as it is.
    pub(super) async fn serve(mut self, mut orders: mpsc::Receiver<Order>, cancel: CancellationToken) {
        while self.step(&cancel, Some(&mut orders)).await {}
        for (_, active) in std::mem::take(&mut self.runs) {
            hand_over(active);
        }
        self.dismiss(true).await;
    }

    /// Does the next thing; `false` where all is to end.
    async fn step(&mut self, cancel: &CancellationToken, orders: Option<&mut mpsc::Receiver<Order>>) -> bool {
        let wake = self.runs.values().map(|active| active.run.wake_at()).min();
        // One job has all the workers there are: nothing is to be shared out before one comes.
        let share_at = (self.runs.len() > 1 || orders.is_some()).then_some(self.share_at);
        let wake = wake.into_iter().chain(share_at).min().unwrap_or_else(|| Instant::now() + Duration::from_secs(3600));
        let order = async {
            match orders {
                Some(orders) => orders.recv().await,
                None => std::future::pending().await,
            }
        };
        let mut heard = Vec::new();
        tokio::select! {
            biased;
            () = cancel.cancelled() => return false,
            order = order => match order {
                Some(order) => self.obey(order).await,
                None => return false,
            },
            count = self.heard.recv_many(&mut heard, HEARD) => if count == 0 {
                return false;
            },
            () = sleep_until(wake) => {}
        }
        for heard in heard {
            self.hear(heard).await;
        }
        let due: Vec<JobNumber> = self.runs.keys().copied().collect();
        for number in due {
            if let Some(active) = self.runs.get_mut(&number) {
                active.run.wake().await;
            }
            self.noted(number).await;
        }
        self.reap().await;
        if Instant::now() >= self.share_at {
            self.share().await;
        }
        true
    }

    async fn start(
        &mut self,
        number: JobNumber,
        job: RenderJob,
        standing: Standing,
        (progress, end): (watch::Sender<Progress>, Option<oneshot::Sender<FinishedRun>>),
    ) -> Result<(), RenderError> {
        let offer = Offer::new(job.scene.scene().clone(), job.settings, job.pixels);
        self.start_offered(number, (job, offer), standing, (progress, end)).await
    }

    async fn start_offered(
        &mut self,
        number: JobNumber,
        (job, offer): (RenderJob, Offer),
        standing: Standing,
        (progress, end): (watch::Sender<Progress>, Option<oneshot::Sender<FinishedRun>>),
    ) -> Result<(), RenderError> {
        self.shared.offer(number, offer);
        let run = Run::start(number, job, progress, self.shared.heard.clone(), self.hired);
        let mut run = run.inspect_err(|_| {
            let _ = self.shared.withdraw(number);
        })?;
        run.begin_first().await;
        self.runs.insert(number, Active { run, standing, end });
        self.share().await;
        Ok(())
    }

    async fn obey(&mut self, order: Order) {
        match order {
            Order::Start { number, job, standing, progress, scene, end } => {
                let offer = Offer::new(job.scene.scene().clone(), job.settings, job.pixels).described(scene);
                if let Err(e) = self.start_offered(number, (*job, offer), standing, (progress, Some(end))).await {
                    // Whoever waits for its end sees that there will be none.
                    tracing::error!("a job cannot be begun: {e}");
                }
            }
            Order::Stop(number) => {
                if let Some(active) = self.runs.remove(&number) {
                    self.free(number);
                    hand_over(active);
                    self.share().await;
                }
            }
            Order::Forget(hash) => self.forget(hash),
            Order::Drain(name) => {
                let worker = self.sessions.iter().find(|(_, s)| s.name == name).map(|(&worker, _)| worker);
                if let Some(worker) = worker {
                    self.retire(worker).await;
                }
            }
        }
    }

    /// Ends the jobs that came to their end.
    async fn reap(&mut self) {
        // Of one that is alone, whoever runs this takes care.
        let over = |active: &Active| active.run.is_over() && active.end.is_some();
        let numbers: Vec<JobNumber> = self.runs.iter().filter(|(_, a)| over(a)).map(|(&number, _)| number).collect();
        if numbers.is_empty() {
            return;
        }
        for number in numbers {
            if let Some(active) = self.runs.remove(&number) {
                self.free(number);
                hand_over(active);
            }
        }
        self.share().await;
    }

    /// A job is over: nobody renders for it any more.
    fn free(&mut self, number: JobNumber) {
        let _ = self.shared.withdraw(number);
        for session in self.sessions.values_mut() {
            if session.job == Some(number) {
                session.job = None;
            }
            session.unable.remove(&number);
        }
    }

    /// Tells workers that they need not keep a scene.
    fn forget(&mut self, hash: SceneHash) {
        if self.shared.keeps(hash) {
            return;
        }
        for session in self.sessions.values() {
            let forget = Forget { scene_sha256: hash.0.to_vec() };
            // Where there is no room for it, the worker drops the scene when it needs the memory.
            let _ = session.outbox.try_send(Ok(CoordinatorMessage { kind: Some(Kind::Forget(forget)) }));
        }
    }

    async fn hear(&mut self, heard: FarmEvent) {
        match heard {
            FarmEvent::Joined(joined) => self.admit(joined).await,
            FarmEvent::Left { worker, cause } => self.left(worker, &cause).await,
            FarmEvent::Decided { check, sum } => {
                let number = LeaseId(check).job();
                if let Some(active) = self.runs.get_mut(&number) {
                    active.run.decides(check, sum).await;
                }
                self.noted(number).await;
            }
            FarmEvent::Described(number) => self.tell_job(number),
            // Words that were on their way when the session ended.
            FarmEvent::Said { worker, said } if self.sessions.contains_key(&worker) => self.said(worker, said).await,
            FarmEvent::Said { .. } => {}
        }
    }

    async fn said(&mut self, worker: WorkerKey, said: WorkerEvent) {
        let number = match &said {
            WorkerEvent::Done(done) => Some(done.lease.job()),
            WorkerEvent::Failed { lease, .. } | WorkerEvent::Returned { lease, .. } | WorkerEvent::Stale(lease) => {
                Some(lease.job())
            }
            WorkerEvent::Ready(number) | WorkerEvent::Unable(number, _) => Some(*number),
            WorkerEvent::Draining => {
                return self.drains(worker).await;
            }
            WorkerEvent::Nonsense(_) => None,
        };
        let session_job = self.sessions.get(&worker).and_then(|s| s.job);
        match (number, said) {
            (_, WorkerEvent::Nonsense(rule)) => self.cut_off(worker, CutOff::Broke(rule)).await,
            (Some(number), WorkerEvent::Unable(_, cause)) => {
                if let Some(session) = self.sessions.get_mut(&worker) {
                    session.unable.insert(number);
                    session.job = session.job.filter(|job| *job != number);
                    tracing::warn!(target: FARM, "{} cannot render this: {cause}", session.name);
                }
                self.pass_on(number, worker, WorkerEvent::Unable(number, cause)).await;
                self.share().await;
            }
            // It was given to another job meanwhile, or it is over.
            (Some(number), WorkerEvent::Ready(_)) if session_job != Some(number) && self.shared.was_given(number) => {}
            (Some(number), WorkerEvent::Ready(_)) if session_job != Some(number) => {
                self.cut_off(worker, CutOff::Broke("it is ready for a job that there is not".into())).await;
            }
            (Some(number), said) if self.runs.contains_key(&number) => self.pass_on(number, worker, said).await,
            // An answer to a lease of a job that is over comes late; else there was never such a lease.
            (Some(number), _) if !self.shared.was_given(number) => {
                self.cut_off(worker, CutOff::Broke("it answered a lease which it does not hold".into())).await;
            }
            _ => {}
        }
    }

    /// Tells a job what a worker said.
    async fn pass_on(&mut self, number: JobNumber, worker: WorkerKey, said: WorkerEvent) {
        if let Some(active) = self.runs.get_mut(&number) {
            active.run.said(worker, said).await;
        }
        self.noted(number).await;
        if self.sessions.get(&worker).is_some_and(|s| s.retired) {
            self.dismiss_retired(worker);
        }
    }

    /// Takes in what happened in a job and is not of it alone.
    async fn noted(&mut self, number: JobNumber) {
        // What follows from it may make more.
        while let Some(notes) = self.runs.get_mut(&number).map(|a| a.run.take_notes()).filter(|n| !n.is_empty()) {
            for note in notes {
                match note {
                    Note::Counted { worker, pixels, rays, busy } => self.counted(worker, pixels, rays, busy),
                    Note::Lost { worker, tiles } => {
                        let place = self.sessions.get(&worker).map(|s| s.place);
                        if let Some(w) = place.and_then(|p| self.figures.get_mut(p)) {
                            w.lost += tiles;
                        }
                    }
                    Note::Verified { id } => {
                        if let Some(w) = self.roster.place(id).and_then(|place| self.figures.get_mut(place)) {
                            w.verified += 1;
                        }
                    }
                    Note::CutOff { worker, why, cause, lost } => {
                        if let (CutOff::Broke(rule), Some(session)) = (&why, self.sessions.get(&worker)) {
                            self.roster.ban(session.id, rule.clone());
                        }
                        if let Some(session) = self.sessions.get_mut(&worker) {
                            session.lost += lost;
                        }
                        self.end_session_of(worker, &cause).await;
                    }
                    Note::Ban { id, rule } => {
                        self.roster.ban(id, rule.clone());
                        let worker = self.sessions.iter().find(|(_, s)| s.id == id).map(|(&worker, _)| worker);
                        // Where it is with this job, that ends its session itself.
                        if let Some(worker) = worker.filter(|w| !self.is_with(number, *w)) {
                            self.cut_off(worker, CutOff::Broke(rule)).await;
                        }
                    }
                }
            }
        }
    }

    fn is_with(&self, number: JobNumber, worker: WorkerKey) -> bool {
        self.runs.get(&number).is_some_and(|a| a.run.has(worker))
    }

    fn counted(&mut self, worker: WorkerKey, pixels: u64, rays: RayCounts, busy: Duration) {
        let place = self.sessions.get(&worker).map(|s| s.place);
        if let Some(w) = place.and_then(|p| self.figures.get_mut(p)) {
            w.tiles += 1;
            w.pixels += pixels;
            w.rays += rays;
            w.busy += busy;
        }
    }

    /// Shows the workers to whoever watches.
    fn show(&mut self) {
        if self.views.receiver_count() == 0 {
            return;
        }
        for (&worker, session) in &self.sessions {
            let holds = session.job.and_then(|n| self.runs.get(&n)).is_some_and(|a| !a.run.is_idle(worker));
            if let Some(w) = self.figures.get_mut(session.place) {
                w.holds = usize::from(holds);
            }
        }
        let views = self.sessions.values().filter_map(|session| {
            let stats = self.figures.get(session.place)?.clone();
            Some(WorkerView { stats, job: session.job, draining: session.draining })
        });
        self.views.send_replace(views.collect());
    }
}

/// Gives what there is of a job to whoever waits for it.
fn hand_over(active: Active) {
    if let Some(end) = active.end {
        // Nobody may wait any more.
        let _ = end.send(active.run.finish(RenderError::Cancelled));
    }
}
