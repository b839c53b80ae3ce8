//! The queue's thread: it alone changes jobs, and keeps every change before it tells it.

mod tidy;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use tessera_proto::JobNumber;
use tessera_proto::control::{Job, Spec, State};
use tokio::runtime::Handle;
use tokio::sync::{oneshot, watch};

use super::choose::{ACTIVE, Waiting};
use super::keep::Keep;
use super::load::{Loaded, load, outcome};
use super::spans::Spans;
use super::spec::{check, key, rank};
use super::store::{Left, Store};
use super::{Ask, Change, Entry, Jobs, Refused, Reply, UNWRITTEN, is_final, now_ms, state_name};
use crate::error::RenderError;
use crate::farm::{FARM, Order, Standing};
use crate::job::{Rendered, Unfinished};
use crate::journal::Journal;
use crate::progress::Progress;

/// Between two looks at whose turn it is, and at what need not be kept.
const LOOK_EVERY: Duration = Duration::from_secs(5);

/// What came of rendering a job.
pub(super) struct End {
    rendered: Result<Rendered, Unfinished>,
    journal: Arc<Journal>,
}

/// A job that is being rendered, or made ready for it.
struct Running {
    number: JobNumber,
    since: Instant,
    /// Whether it was told to stop.
    stopping: bool,
    /// Whether the farm has it.
    begun: bool,
}

/// See the [module](self).
pub(super) struct Engine {
    store: Arc<Store>,
    jobs: Arc<Jobs>,
    orders: tokio::sync::mpsc::Sender<Order>,
    me: Sender<Ask>,
    asks: Receiver<Ask>,
    keep: Keep,
    runtime: Handle,
    next_id: u64,
    next_number: u64,
    waiting: Waiting,
    running: BTreeMap<u64, Running>,
    /// Jobs that are not over, by when they are given up, in milliseconds since 1970.
    deadlines: BTreeSet<(u64, u64)>,
    /// Finished jobs by what their pictures depend on.
    finished: HashMap<[u8; 32], u64>,
    spans: Spans,
    /// Where it closes, who waits for that.
    closing: Option<oneshot::Sender<()>>,
}

impl Engine {
    /// With what an earlier run left. Must be called inside a runtime.
    pub(super) fn new(
        (store, jobs): (Arc<Store>, Arc<Jobs>),
        left: Left,
        orders: tokio::sync::mpsc::Sender<Order>,
        (me, asks): (Sender<Ask>, Receiver<Ask>),
        keep: Keep,
    ) -> Self {
        let (waiting, finished) = (Waiting::default(), HashMap::new());
        let mut engine = Self {
            store,
            jobs,
            orders,
            me,
            asks,
            keep,
            runtime: Handle::current(),
            next_id: left.next_id,
            next_number: 0,
            waiting,
            running: BTreeMap::new(),
            deadlines: BTreeSet::new(),
            finished,
            spans: Spans::default(),
            closing: None,
        };
        for mut job in left.jobs {
            engine.next_id = engine.next_id.max(job.id + 1);
            if job.state() == State::Rendering {
                // It goes on from its journal.
                job.set_state(State::Queued);
            }
            if matches!(job.state(), State::Done | State::Cancelled) {
                // A crash may have left it.
                let _ = std::fs::remove_file(engine.store.journal(job.id));
            }
            engine.place(job);
        }
        engine
    }

    /// Puts a job, as it is now, where everybody sees it.
    fn place(&mut self, job: Job) {
        let Some(spec) = &job.spec else { return };
        self.spans.is(&job);
        let rank = rank(spec, job.id);
        match job.state() {
            State::Queued | State::Rendering => self.waiting.insert(&spec.owner, rank),
            _ => self.waiting.remove(&spec.owner, rank),
        }
        if spec.deadline_ms > 0 {
            let due = (spec.deadline_ms, job.id);
            let _ = if is_final(job.state()) { self.deadlines.remove(&due) } else { self.deadlines.insert(due) };
        }
        if job.state() == State::Done
            && job.result.as_ref().is_some_and(|r| r.target_met != Some(false))
            && let Some(key) = key(spec)
        {
            self.finished.insert(key, job.id);
        }
        let mut entries = self.jobs.entries();
        let before = entries.remove(&job.id).filter(|_| !is_final(job.state()));
        let (progress, canvas) = before.map_or((None, None), |e| (e.progress, e.canvas));
        entries.insert(job.id, Entry { job, progress, canvas });
        drop(entries);
        self.jobs.changed.send_modify(|n| *n += 1);
    }

    /// Keeps a job as it is now, and then shows it.
    fn commit(&mut self, job: Job) -> Result<Job, Refused> {
        let kept = self.store.put(&job, self.next_id).map_err(|e| Refused::Disk(e.to_string()));
        self.jobs.trouble(kept.is_err().then_some(UNWRITTEN));
        kept?;
        let before = self.job(job.id).map(|j| j.state());
        if before != Some(job.state()) && job.state() != State::Failed {
            let spec = job.spec.as_ref();
            let (name, owner) = spec.map_or(("", ""), |s| (&s.name, &s.owner));
            tracing::info!(target: FARM, "job {} '{name}' of {owner}: {}", job.id, state_name(job.state()));
        }
        self.place(job.clone());
        Ok(job)
    }

    /// As [`Engine::commit`], where nobody waits for it. What cannot be kept is shown, and done again after a restart.
    fn settle(&mut self, job: Job) {
        if let Err(e) = self.commit(job.clone()) {
            tracing::error!("job {}: {e}", job.id);
            self.place(job);
        }
    }

    fn job(&self, id: u64) -> Option<Job> {
        self.jobs.entries().get(&id).map(|e| e.job.clone())
    }

    /// Does what is asked until the queue is closed.
    pub(super) fn run(mut self) {
        let mut look_at = Instant::now();
        loop {
            if Instant::now() >= look_at {
                look_at = Instant::now() + LOOK_EVERY;
                self.tidy();
                self.choose();
            }
            let wait = look_at.saturating_duration_since(Instant::now()).min(self.give_up());
            match self.asks.recv_timeout(wait) {
                Ok(ask) => self.hear(ask),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            if self.running.is_empty()
                && let Some(closing) = self.closing.take()
            {
                self.spans.close();
                let _ = closing.send(());
                return;
            }
        }
    }

    fn hear(&mut self, ask: Ask) {
        match ask {
            Ask::Submit(spec, reply) => self.answer(reply, |engine| engine.submit(*spec)),
            Ask::Change(id, change, reply) => self.answer(reply, |engine| engine.change(id, change)),
            Ask::Fetched(id) => {
                if let Some(mut job) = self.job(id).filter(|j| j.state() == State::Done) {
                    job.fetched_ms = now_ms();
                    self.settle(job);
                }
            }
            Ask::Loaded(id, loaded) => self.loaded(id, loaded),
            Ask::Ended(id, end) => self.ended(id, *end),
            Ask::Close(reply) => {
                self.closing = Some(reply);
                for id in self.running.keys().copied().collect::<Vec<_>>() {
                    self.stop(id);
                }
            }
        }
    }

    fn answer(&mut self, reply: Reply<Job>, work: impl FnOnce(&mut Self) -> Result<Job, Refused>) {
        let done = if self.closing.is_some() { Err(Refused::Closing) } else { work(self) };
        let changed = done.is_ok();
        // Told first: whoever waits does not wait for what follows from it.
        let _ = reply.send(done);
        if changed {
            self.choose();
        }
    }

    fn submit(&mut self, spec: Spec) -> Result<Job, Refused> {
        let asked = check(&spec)?;
        if !self.store.scene(asked.scene.0).exists() {
            return Err(Refused::NoScene);
        }
        let same = key(&spec).and_then(|key| self.finished.get(&key)).and_then(|&id| self.job(id));
        let mut job = Job { id: self.next_id, spec: Some(spec), submitted_ms: now_ms(), ..Job::default() };
        job.set_state(State::Queued);
        if let Some(same) = same.filter(|same| self.has_pixels(same)) {
            job.set_state(State::Done);
            job.result = same.result;
            job.same_as = if same.same_as > 0 { same.same_as } else { same.id };
            job.ended_ms = job.submitted_ms;
        }
        self.next_id += 1;
        self.commit(job)
    }

    fn has_pixels(&self, job: &Job) -> bool {
        let hash = job.result.as_ref().and_then(|r| r.pixels_sha256.as_slice().try_into().ok());
        hash.is_some_and(|hash| self.store.pixels(hash).exists())
    }

    fn change(&mut self, id: u64, change: Change) -> Result<Job, Refused> {
        let mut job = self.job(id).ok_or(Refused::Unknown(id))?;
        let state = job.state();
        let (to, done) = match change {
            Change::Pause => (State::Paused, "paused"),
            Change::Resume => (State::Queued, "resumed"),
            Change::Cancel => (State::Cancelled, "cancelled"),
        };
        let fits = match change {
            Change::Pause => matches!(state, State::Queued | State::Rendering),
            Change::Resume => matches!(state, State::Paused | State::Failed),
            Change::Cancel => !is_final(state),
        };
        if !fits {
            return Err(Refused::State(id, state_name(state), done));
        }
        job.set_state(to);
        if state == State::Failed
            && let Some(spec) = job.spec.as_mut().filter(|s| (1..=now_ms()).contains(&s.deadline_ms))
        {
            spec.deadline_ms = 0;
        }
        job.failure.clear();
        job.ended_ms = if is_final(to) { now_ms() } else { 0 };
        let job = self.commit(job)?;
        self.stop(id);
        if to == State::Cancelled && !self.running.contains_key(&id) {
            let _ = std::fs::remove_file(self.store.journal(id));
        }
        Ok(job)
    }

    /// Has the farm render what is due, and nothing else.
    fn choose(&mut self) {
        if self.closing.is_some() {
            return;
        }
        let since = self.running.iter().filter(|(_, r)| !r.stopping).map(|(&id, r)| (id, r.since)).collect();
        let chosen = self.waiting.choose(&since, Instant::now());
        for id in self.running.keys().filter(|id| !chosen.contains(id)).copied().collect::<Vec<_>>() {
            self.stop(id);
        }
        for id in chosen {
            if self.running.len() < ACTIVE && !self.running.contains_key(&id) {
                self.start(id);
            }
        }
    }

    /// Has a job rendered no more; what becomes of it then is as its state says.
    fn stop(&mut self, id: u64) {
        let Some(running) = self.running.get_mut(&id) else { return };
        if !std::mem::replace(&mut running.stopping, true) && running.begun {
            let _ = self.orders.blocking_send(Order::Stop(running.number));
        }
    }

    /// Makes a job ready, on a thread of its own.
    fn start(&mut self, id: u64) {
        let Some(mut job) = self.job(id) else { return };
        let Some(asked) = job.spec.as_ref().map(check) else { return };
        if self.next_number >= JobNumber::END {
            tracing::error!("no more jobs can be begun: start the farm anew");
            return;
        }
        let number = JobNumber(self.next_number);
        self.next_number += 1;
        if job.state() != State::Rendering {
            job.set_state(State::Rendering);
            if job.started_ms == 0 {
                job.started_ms = now_ms();
            }
            self.settle(job);
        }
        self.running.insert(id, Running { number, since: Instant::now(), stopping: false, begun: false });
        let (store, me) = (self.store.clone(), self.me.clone());
        let load = move || {
            let loaded = asked.map_err(|e| e.to_string()).and_then(|asked| load(&store, id, &asked));
            let _ = me.send(Ask::Loaded(id, loaded.map(Box::new)));
        };
        if let Err(e) = std::thread::Builder::new().name("load".into()).spawn(load) {
            let _ = self.me.send(Ask::Loaded(id, Err(format!("no thread: {e}"))));
        }
    }

    fn loaded(&mut self, id: u64, loaded: Result<Box<Loaded>, String>) {
        let Some(running) = self.running.get_mut(&id) else { return };
        let loaded = match loaded {
            Ok(loaded) if !running.stopping => *loaded,
            Ok(loaded) => {
                // Its file is let go of, so that it can be gone on from.
                drop(loaded);
                return self.stopped(id);
            }
            Err(cause) => {
                self.running.remove(&id);
                return self.failed(id, cause);
            }
        };
        running.begun = true;
        let number = running.number;
        self.jobs.numbers().insert(number.0, id);
        let Loaded { mut job, journal, scene } = loaded;
        job.span = self.spans.begun(id);
        let (progress, watched) = watch::channel(Progress::default());
        if let Some(entry) = self.jobs.entries().get_mut(&id) {
            (entry.progress, entry.canvas) = (Some(watched), job.canvas.clone());
        }
        let standing = self
            .job(id)
            .and_then(|j| j.spec)
            .map_or_else(Standing::default, |spec| Standing { owner: spec.owner.clone(), rank: rank(&spec, id) });
        let (end, ended) = oneshot::channel();
        let order = Order::Start { number, job: Box::new(job), standing, progress, scene, end };
        let _ = self.orders.blocking_send(order);
        let me = self.me.clone();
        self.runtime.spawn(async move {
            let rendered = match ended.await {
                Ok(finished) => finished.rendered(0).await,
                Err(_) => Err(RenderError::Internal("it could not be begun".into()).into()),
            };
            let _ = me.send(Ask::Ended(id, Box::new(End { rendered, journal })));
        });
    }

    fn ended(&mut self, id: u64, end: End) {
        let Some(running) = self.running.remove(&id) else { return };
        self.jobs.numbers().remove(&running.number.0);
        if let Some(entry) = self.jobs.entries().get_mut(&id) {
            (entry.progress, entry.canvas) = (None, None);
        }
        let state = self.job(id).map_or(State::Cancelled, |j| j.state());
        match end.rendered {
            Ok(rendered) if state == State::Rendering => self.done(id, &rendered, &end.journal),
            Err(Unfinished { error: RenderError::Cancelled, .. }) | Ok(_) => {
                if state == State::Cancelled {
                    end.journal.remove();
                } else {
                    let _ = end.journal.kept();
                }
                drop(end.journal);
                self.stopped(id);
            }
            Err(Unfinished { error, .. }) => {
                let _ = end.journal.kept();
                self.failed(id, error.to_string());
            }
        }
        self.choose();
    }

    /// A job is rendered no more, and did not come to its end.
    fn stopped(&mut self, id: u64) {
        self.running.remove(&id);
        let Some(mut job) = self.job(id) else { return };
        match job.state() {
            State::Rendering => {
                job.set_state(State::Queued);
                self.settle(job);
            }
            State::Cancelled => {
                let _ = std::fs::remove_file(self.store.journal(id));
            }
            _ => {}
        }
        self.choose();
    }

    fn failed(&mut self, id: u64, cause: String) {
        let Some(mut job) = self.job(id) else { return };
        if is_final(job.state()) {
            return;
        }
        tracing::error!(target: FARM, "job {id} failed: {cause}");
        job.set_state(State::Failed);
        job.failure = cause;
        job.ended_ms = now_ms();
        self.settle(job);
    }

    /// A picture is whole: it is on the disk before the job is said to be done.
    fn done(&mut self, id: u64, rendered: &Rendered, journal: &Journal) {
        let Some(mut job) = self.job(id) else { return };
        let hash = match self.store.put_pixels(&rendered.image) {
            Ok(hash) => hash,
            Err(e) => {
                let _ = journal.kept();
                return self.failed(id, format!("the picture cannot be kept: {e}; once there is room, resume the job"));
            }
        };
        job.set_state(State::Done);
        job.ended_ms = now_ms();
        job.result = Some(Box::new(outcome(rendered, hash)));
        match self.commit(job) {
            Ok(_) => journal.remove(),
            Err(e) => {
                let _ = journal.kept();
                self.failed(id, e.to_string());
            }
        }
    }
}
