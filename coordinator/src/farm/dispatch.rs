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

use super::pulse::Pulse;
use super::roster::Roster;
use super::run::{Finished as FinishedRun, Note, Run};
use super::service::{Door, Heard, Mouth, Offer, Said};
use super::shares::Shares;
use super::timing::Timing;
use crate::job::{Progress, RenderError, RenderJob, WorkerStats};
use crate::scheduler::{CutOff, WorkerKey};

/// Between two looks at who should render for whom, where nothing calls for one.
const SHARE_EVERY: Duration = Duration::from_millis(250);
/// What comes and goes is said under this name, also where nothing else is.
pub(crate) const FARM: &str = "farm";

/// A worker that is connected.
struct Seat {
    session: SessionId,
    mouth: Mouth,
    cut: CancellationToken,
    id: WorkerId,
    instance: InstanceId,
    name: String,
    address: String,
    threads: u32,
    /// Whether it is one of this process.
    own: bool,
    pulse: Pulse,
    /// Its pulse when it was last looked at, and when that changed.
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
    door: Arc<Door>,
    heard: mpsc::Receiver<Heard>,
    timing: Timing,
    /// Workers of this process that will come.
    hired: usize,
    runs: BTreeMap<JobNumber, Active>,
    seats: BTreeMap<WorkerKey, Seat>,
    roster: Roster,
    figures: Vec<WorkerStats>,
    shares: Shares,
    shared: Instant,
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
    pub(super) fn new(door: Arc<Door>, heard: mpsc::Receiver<Heard>, timing: Timing, hired: usize) -> Self {
        let now = Instant::now();
        Self {
            door,
            heard,
            timing,
            hired,
            runs: BTreeMap::new(),
            seats: BTreeMap::new(),
            roster: Roster::default(),
            figures: Vec::new(),
            shares: Shares::default(),
            shared: now,
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
        cancel: &CancellationToken,
    ) -> Result<FinishedRun, RenderError> {
        let number = JobNumber(0);
        self.start(number, job, Standing::default(), (progress, None)).await?;
        while self.runs.get(&number).is_some_and(|active| !active.run.is_over()) {
            if !self.step(cancel, None).await {
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
    pub(super) async fn serve(mut self, mut orders: mpsc::Receiver<Order>, cancel: &CancellationToken) {
        while self.step(cancel, Some(&mut orders)).await {}
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
        tokio::select! {
            biased;
            () = cancel.cancelled() => return false,
            order = order => match order {
                Some(order) => self.obey(order).await,
                None => return false,
            },
            heard = self.heard.recv() => match heard {
                Some(heard) => self.hear(heard).await,
                None => return false,
            },
            () = sleep_until(wake) => {}
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
        self.door.offer(number, offer);
        let run = Run::start(number, job, progress, self.door.heard.clone(), self.hired);
        let mut run = run.inspect_err(|_| {
            let _ = self.door.withdraw(number);
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
                let worker = self.seats.iter().find(|(_, s)| s.name == name).map(|(&worker, _)| worker);
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
        let _ = self.door.withdraw(number);
        for seat in self.seats.values_mut() {
            if seat.job == Some(number) {
                seat.job = None;
            }
            seat.unable.remove(&number);
        }
    }

    /// Tells workers that they need not keep a scene.
    fn forget(&mut self, hash: SceneHash) {
        if self.door.keeps(hash) {
            return;
        }
        for seat in self.seats.values() {
            let forget = Forget { scene_sha256: hash.0.to_vec() };
            // Where there is no room for it, the worker drops the scene when it needs the memory.
            let _ = seat.mouth.try_send(Ok(CoordinatorMessage { kind: Some(Kind::Forget(forget)) }));
        }
    }

    async fn hear(&mut self, heard: Heard) {
        match heard {
            Heard::Joined(joined) => self.admit(joined).await,
            Heard::Left { worker, cause } => self.left(worker, &cause).await,
            Heard::Decided { check, sum } => {
                let number = LeaseId(check).job();
                if let Some(active) = self.runs.get_mut(&number) {
                    active.run.decides(check, sum).await;
                }
                self.noted(number).await;
            }
            Heard::Described(number) => self.tell_job(number),
            // Words that were on their way when the session ended.
            Heard::Said { worker, said } if self.seats.contains_key(&worker) => self.said(worker, said).await,
            Heard::Said { .. } => {}
        }
    }

    async fn said(&mut self, worker: WorkerKey, said: Said) {
        let number = match &said {
            Said::Done(done) => Some(done.lease.job()),
            Said::Failed { lease, .. } | Said::Returned { lease, .. } | Said::Stale(lease) => Some(lease.job()),
            Said::Ready(number) | Said::Unable(number, _) => Some(*number),
            Said::Draining => {
                return self.drains(worker).await;
            }
            Said::Nonsense(_) => None,
        };
        let seat_job = self.seats.get(&worker).and_then(|s| s.job);
        match (number, said) {
            (_, Said::Nonsense(rule)) => self.cut_off(worker, CutOff::Broke(rule)).await,
            (Some(number), Said::Unable(_, cause)) => {
                if let Some(seat) = self.seats.get_mut(&worker) {
                    seat.unable.insert(number);
                    seat.job = seat.job.filter(|job| *job != number);
                    tracing::warn!(target: FARM, "{} cannot render this: {cause}", seat.name);
                }
                self.pass_on(number, worker, Said::Unable(number, cause)).await;
                self.share().await;
            }
            // It was given to another job meanwhile, or it is over.
            (Some(number), Said::Ready(_)) if seat_job != Some(number) && self.door.was_given(number) => {}
            (Some(number), Said::Ready(_)) if seat_job != Some(number) => {
                self.cut_off(worker, CutOff::Broke("it is ready for a job that there is not".into())).await;
            }
            (Some(number), said) if self.runs.contains_key(&number) => self.pass_on(number, worker, said).await,
            // An answer to a lease of a job that is over comes late; else there was never such a lease.
            (Some(number), _) if !self.door.was_given(number) => {
                self.cut_off(worker, CutOff::Broke("it answered a lease which it does not hold".into())).await;
            }
            _ => {}
        }
    }

    /// Tells a job what a worker said.
    async fn pass_on(&mut self, number: JobNumber, worker: WorkerKey, said: Said) {
        if let Some(active) = self.runs.get_mut(&number) {
            active.run.said(worker, said).await;
        }
        self.noted(number).await;
        if self.seats.get(&worker).is_some_and(|s| s.retired) {
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
                        let place = self.seats.get(&worker).map(|s| s.place);
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
                        if let (CutOff::Broke(rule), Some(seat)) = (&why, self.seats.get(&worker)) {
                            self.roster.ban(seat.id, rule.clone());
                        }
                        if let Some(seat) = self.seats.get_mut(&worker) {
                            seat.lost += lost;
                        }
                        self.unseat(worker, &cause).await;
                    }
                    Note::Ban { id, rule } => {
                        self.roster.ban(id, rule.clone());
                        let worker = self.seats.iter().find(|(_, s)| s.id == id).map(|(&worker, _)| worker);
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
        let place = self.seats.get(&worker).map(|s| s.place);
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
        for (&worker, seat) in &self.seats {
            let holds = seat.job.and_then(|n| self.runs.get(&n)).is_some_and(|a| !a.run.is_idle(worker));
            if let Some(w) = self.figures.get_mut(seat.place) {
                w.holds = usize::from(holds);
            }
        }
        let views = self.seats.values().filter_map(|seat| {
            let stats = self.figures.get(seat.place)?.clone();
            Some(WorkerView { stats, job: seat.job, draining: seat.draining })
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
