//! Holds as many workers as there is work for, and leaves none behind.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::call::CallError;
use super::placement::{Placement, Standing};
use super::{Demand, Engine, Fleet};

/// Between two decisions.
const TICK: Duration = Duration::from_millis(500);
/// Between two questions to the engine, which many others ask, too.
const ASK_EVERY: Duration = Duration::from_secs(5);
/// Between two submissions of which no worker joined, at first and at last.
const RETRY: (Duration, Duration) = (Duration::from_secs(2), Duration::from_secs(120));
/// How long the engine may take to end what it has.
const END_WITHIN: Duration = Duration::from_secs(90);

/// Why a fleet is of no use.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FleetError {
    /// The first workers were refused.
    #[error("{engine} takes no workers: {why}")]
    Refused {
        /// Which.
        engine: String,
        /// As it said.
        why: String,
    },
    /// Jobs may be left.
    #[error("{engine} did not end all workers: {why}; see to it by: {remedy}")]
    Left {
        /// Which.
        engine: String,
        /// As it said.
        why: String,
        /// What to type.
        remedy: String,
    },
    /// No thread for it.
    #[error("cannot start: {0}")]
    Start(String),
}

/// A fleet that is kept, on a thread of its own: whatever occupies the farm, its workers are ended.
#[derive(Debug)]
pub struct Keeper {
    stop: CancellationToken,
    thread: Option<std::thread::JoinHandle<Result<(), FleetError>>>,
    failed: CancellationToken,
}

impl Keeper {
    /// Starts to keep `fleet`, by what `demand` says until it is over or its sender is gone. Where the engine refuses
    /// the very first workers, the fleet has failed if `must_start`; else it is tried again.
    ///
    /// # Errors
    /// When there is no thread for it.
    pub fn start(fleet: Fleet, demand: watch::Receiver<Demand>, must_start: bool) -> Result<Self, FleetError> {
        let (stop, failed) = (CancellationToken::new(), CancellationToken::new());
        let (stopped, tell) = (stop.clone(), failed.clone());
        let engine = fleet.engine.to_string();
        let refused = |e: CallError| FleetError::Refused { engine, why: e.to_string() };
        let place = Placement::new(&fleet.engine).map_err(refused)?;
        let keep = move || {
            // It may not be dropped where another one runs.
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            let kept = runtime.map_err(|e| FleetError::Start(e.to_string())).and_then(|runtime| {
                runtime.block_on(async {
                    let mut kept = Kept::new(fleet, place, must_start);
                    let ran = kept.run(demand, &stopped).await;
                    let ended = kept.end().await;
                    ran.and(ended)
                })
            });
            if kept.is_err() {
                tell.cancel();
            }
            kept
        };
        let thread = std::thread::Builder::new().name("fleet".into()).spawn(keep);
        Ok(Self { stop, thread: Some(thread.map_err(|e| FleetError::Start(e.to_string()))?), failed })
    }

    /// Begins to end all workers.
    pub fn stop(&self) {
        self.stop.cancel();
    }

    /// Ends all workers, and waits until the engine has none.
    ///
    /// # Errors
    /// When it failed before, or jobs may be left.
    pub fn end(mut self) -> Result<(), FleetError> {
        self.stop.cancel();
        self.join()
    }

    /// Waits until the fleet is of no use any more, for want of an engine that takes it or of a farm.
    pub async fn failed(&self) {
        self.failed.cancelled().await;
    }

    /// Whether it came to its end.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(std::thread::JoinHandle::is_finished)
    }

    fn join(&mut self) -> Result<(), FleetError> {
        let ended = self.thread.take().map_or(Ok(Ok(())), std::thread::JoinHandle::join);
        ended.unwrap_or_else(|_| Err(FleetError::Start("the fleet's thread panicked".into())))
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.stop.cancel();
        let _ = self.join();
    }
}

/// The workers of a fleet, as the engine has them.
struct Kept {
    fleet: Fleet,
    place: Placement,
    standing: Standing,
    /// Whether a submission was ever taken.
    started: bool,
    must_start: bool,
    /// Not before then is anything submitted again.
    not_before: Option<Instant>,
    retry: Duration,
    /// Since when there is too little to do for all.
    slack_since: Option<Instant>,
    /// What was said already.
    said: BTreeSet<String>,
}

impl Kept {
    fn new(fleet: Fleet, place: Placement, must_start: bool) -> Self {
        Self {
            place,
            fleet,
            standing: Standing::default(),
            started: false,
            must_start,
            not_before: None,
            retry: RETRY.0,
            slack_since: None,
            said: BTreeSet::new(),
        }
    }

    /// Decides again and again, until there is nothing more to do. No submission is broken off: its job would be unknown.
    async fn run(&mut self, mut demand: watch::Receiver<Demand>, stop: &CancellationToken) -> Result<(), FleetError> {
        let mut asked = Instant::now();
        loop {
            let now = *demand.borrow_and_update();
            if now.over || stop.is_cancelled() {
                return Ok(());
            }
            if asked.elapsed() >= ASK_EVERY {
                self.ask().await;
                asked = Instant::now();
            }
            self.decide(&now).await?;
            tokio::select! {
                () = stop.cancelled() => {}
                () = tokio::time::sleep(TICK) => {}
                // Without a farm there is nothing to do.
                changed = demand.changed() => if changed.is_err() { return Ok(()) } else { tokio::time::sleep(TICK / 5).await },
            }
        }
    }

    /// Asks the engine what it has.
    async fn ask(&mut self) {
        match self.place.standing(&self.fleet).await {
            Ok(standing) => self.standing = standing,
            Err(e) => self.say_once(format!("does not say what runs: {e}")),
        }
        let reasons: BTreeSet<String> = self.standing.waiting.iter().filter_map(|(_, reason)| reason.clone()).collect();
        for reason in reasons.into_iter().filter(|reason| reason != "None") {
            let what = format!("{} workers wait: {reason}", self.fleet.engine);
            if self.said.insert(what.clone()) {
                tracing::info!(target: "farm", "{what}");
            }
        }
    }

    async fn decide(&mut self, demand: &Demand) -> Result<(), FleetError> {
        let (held, scaling) = (self.standing.count(), self.fleet.scaling);
        if scaling.is_slack(demand, held) {
            self.slack_since.get_or_insert_with(Instant::now);
        } else {
            self.slack_since = None;
        }
        if demand.workers > 0 {
            self.retry = RETRY.0;
        }
        let slack = self.slack_since.map_or(Duration::ZERO, |since| since.elapsed());
        let wanted = scaling.wanted(demand, held, slack);
        if wanted > held {
            self.add(wanted - held).await
        } else {
            self.remove(held - wanted).await;
            Ok(())
        }
    }

    async fn add(&mut self, count: usize) -> Result<(), FleetError> {
        if self.not_before.is_some_and(|at| Instant::now() < at) {
            return Ok(());
        }
        // Workers that end as soon as they start are not to be a flood of jobs.
        self.not_before = Some(Instant::now() + self.retry);
        self.retry = (2 * self.retry).min(RETRY.1);
        let engine = self.fleet.engine.to_string();
        let submitted = self.place.add(&self.fleet, (self.standing.count(), count)).await;
        // Also where a part of them was refused, the others are there.
        if let Ok(standing) = self.place.standing(&self.fleet).await {
            self.standing = standing;
        }
        match submitted {
            Ok(()) => {
                self.started = true;
                let workers = if count == 1 { "a worker".into() } else { format!("{count} workers") };
                tracing::info!(target: "farm", "{engine} is asked for {workers}");
                Ok(())
            }
            // Hosts are known to take no worker only when all have been tried.
            Err(e) if self.must_start && (!self.started || matches!(self.fleet.engine, Engine::Ssh(_))) => {
                Err(FleetError::Refused { engine, why: e.to_string() })
            }
            Err(e) => {
                self.say_once(format!("takes no workers: {e}; it is asked again"));
                Ok(())
            }
        }
    }

    /// Lets workers go, first those that have not begun, then those that came last.
    async fn remove(&mut self, count: usize) {
        if count == 0 {
            return;
        }
        let waiting = self.standing.waiting.iter().map(|(task, _)| task);
        let tasks: Vec<String> = waiting.rev().chain(self.standing.running.iter().rev()).take(count).cloned().collect();
        tracing::info!(target: "farm", "{} is to end {} workers, for want of work", self.fleet.engine, tasks.len());
        match self.place.remove(&self.fleet, &tasks, self.standing.count() - tasks.len()).await {
            Ok(()) => {
                self.standing.waiting.retain(|(task, _)| !tasks.contains(task));
                self.standing.running.retain(|task| !tasks.contains(task));
            }
            Err(e) => self.say_once(format!("does not end workers: {e}")),
        }
    }

    /// Ends all, and sees to it that nothing is left.
    async fn end(&mut self) -> Result<(), FleetError> {
        let (began, mut pause) = (Instant::now(), Duration::from_millis(50));
        let mut why;
        loop {
            why = self.place.remove_all(&self.fleet).await.err();
            match self.place.standing(&self.fleet).await {
                Ok(standing) if standing.count() == 0 => return Ok(()),
                Ok(_) => {}
                Err(e) => why = Some(e),
            }
            if began.elapsed() >= END_WITHIN {
                break;
            }
            tokio::time::sleep(pause).await;
            pause = (2 * pause).min(Duration::from_secs(5));
        }
        Err(FleetError::Left {
            engine: self.fleet.engine.to_string(),
            why: why.as_ref().map_or_else(|| "some are there still".into(), CallError::to_string),
            remedy: self.place.remedy(&self.fleet),
        })
    }

    fn say_once(&mut self, what: String) {
        let what = format!("{} {what}", self.fleet.engine);
        if self.said.insert(what.clone()) {
            tracing::warn!(target: "farm", "{what}");
        }
    }
}
