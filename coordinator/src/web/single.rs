//! A single render, as its page shows it: one job, which can be cancelled.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use tessera_core::film::Region;
use tessera_core::settings::Settings;
use tessera_proto::control::{Job, Spec, State, Worker};
use tessera_proto::{PixelFormat, wire};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::source::Source;
use crate::film::Canvas;
use crate::journal::Partial;
use crate::progress::Progress;
use crate::queue::{Change, Refused, now_ms, progress, state_name, worker_of};

/// The number of the one job.
const ONE: u64 = 1;

/// What is known of a render before it begins. Clones are the same.
#[derive(Clone, Debug)]
pub struct Single(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    spec: Spec,
    canvas: Canvas,
    submitted_ms: u64,
    cancel: CancellationToken,
    /// Once it is rendered.
    progress: OnceLock<watch::Receiver<Progress>>,
}

impl Single {
    /// The render of a scene called `name`; `max_error` as a fraction of full scale. `cancel` gives it up.
    #[must_use]
    pub fn new(
        name: String,
        (settings, region, pixels): (Settings, Region, PixelFormat),
        max_error: Option<f64>,
        cancel: CancellationToken,
    ) -> Self {
        let spec = Spec {
            settings: Some(settings.into()),
            region: Some(wire::Region { x0: region.x0, y0: region.y0, x1: region.x1, y1: region.y1 }),
            pixels: wire::PixelFormat::from(pixels).into(),
            max_error: max_error.unwrap_or(0.0),
            name,
            ..Spec::default()
        };
        let (canvas, progress) = (Canvas::default(), OnceLock::new());
        Self(Arc::new(Inner { spec, canvas, submitted_ms: now_ms(), cancel, progress }))
    }

    /// Where its picture grows.
    #[must_use]
    pub fn canvas(&self) -> Canvas {
        self.0.canvas.clone()
    }

    /// It is rendered now.
    pub fn begin(&self, progress: watch::Receiver<Progress>) {
        let _ = self.0.progress.set(progress);
    }

    fn state(&self) -> State {
        match self.0.progress.get() {
            None => State::Queued,
            Some(_) if self.0.cancel.is_cancelled() => State::Cancelled,
            // Whoever tells of its progress ends with it.
            Some(progress) if progress.has_changed().is_err() => State::Done,
            Some(_) => State::Rendering,
        }
    }

    fn shown(&self) -> Job {
        let mut job = Job {
            id: ONE,
            spec: Some(self.0.spec.clone()),
            submitted_ms: self.0.submitted_ms,
            progress: self.0.progress.get().map(|p| Box::new(progress(&p.borrow()))),
            ..Job::default()
        };
        job.set_state(self.state());
        job
    }
}

#[tonic::async_trait]
impl Source for Single {
    fn ready(&self) -> Result<(), &'static str> {
        match self.state() {
            State::Rendering => Ok(()),
            State::Queued => Err("the scene is being read"),
            _ => Err("the render is over"),
        }
    }

    fn job(&self, id: u64) -> Result<Job, Refused> {
        if id == ONE { Ok(self.shown()) } else { Err(Refused::Unknown(id)) }
    }

    fn list(&self, after: u64, most: usize) -> Vec<Job> {
        if after < ONE { self.latest(most) } else { Vec::new() }
    }

    fn latest(&self, most: usize) -> Vec<Job> {
        (0..most.min(1)).map(|_| self.shown()).collect()
    }

    fn counts(&self) -> BTreeMap<&'static str, u64> {
        [(state_name(self.state()), 1)].into()
    }

    fn changes(&self) -> u64 {
        self.state() as u64
    }

    fn canvas(&self, id: u64) -> Option<Canvas> {
        (id == ONE).then(|| self.canvas())
    }

    fn stored(&self, _: &Job) -> Option<std::path::PathBuf> {
        None
    }

    fn partial(&self, _: u64) -> Option<Partial> {
        None
    }

    fn workers(&self) -> Vec<Worker> {
        let Some(progress) = self.0.progress.get() else { return Vec::new() };
        let progress = progress.borrow();
        progress.workers.iter().filter(|w| w.connected).map(|w| worker_of(w, ONE, false)).collect()
    }

    fn worker_count(&self) -> usize {
        self.0.progress.get().map_or(0, |p| p.borrow().workers.iter().filter(|w| w.connected).count())
    }

    fn actions(&self, state: State) -> &'static [&'static str] {
        if matches!(state, State::Queued | State::Rendering) { &["cancel"] } else { &[] }
    }

    fn can_drain(&self) -> bool {
        false
    }

    async fn change(&self, id: u64, change: Change) -> Result<Job, Refused> {
        let job = self.job(id)?;
        let state = self.state();
        if change != Change::Cancel || !matches!(state, State::Queued | State::Rendering) {
            let done = match change {
                Change::Pause => "paused",
                Change::Resume => "resumed",
                Change::Cancel => "cancelled",
            };
            return Err(Refused::Single(done));
        }
        self.0.cancel.cancel();
        Ok(job)
    }

    async fn drain(&self, _: &str) -> bool {
        false
    }
}
