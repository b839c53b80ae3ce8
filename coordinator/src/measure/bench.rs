//! Where renders are timed, and the reference is made.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tempfile::TempDir;
use tessera_core::film::PixelsRef;
use tessera_core::film::file::{Depth, Output};
use tessera_core::settings::{Sampling, Settings};
use tessera_proto::{PixelFormat, Pixels};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::knob::Knob;
use super::point::{Point, Skipped};
use super::reference::{Blend, Reference};
use super::run::{MeasureError, Order, Stage};
use super::sweep::{self, Costs, Step};
use crate::config::ListenAddr;
use crate::error::RenderError;
use crate::film::Scratch;
use crate::job::{RenderJob, Rendered, SceneSource};
use crate::plan::Goal;
use crate::progress::Progress;

/// A render and its times.
pub(super) struct Job {
    pub(super) rendered: Rendered,
    pub(super) trace: Duration,
    pub(super) whole: Duration,
}

/// The state of a measurement.
pub(super) struct Bench {
    pub(super) order: Order,
    pub(super) stop: CancellationToken,
    pub(super) points: Vec<Point>,
    pub(super) skipped: Vec<Skipped>,
    /// A folder for what is written on the way; gone in the end.
    pub(super) room: TempDir,
    pub(super) costs: Costs,
    tell: watch::Sender<Stage>,
    began: Instant,
}

impl Bench {
    pub(super) fn new(order: Order, tell: watch::Sender<Stage>, stop: CancellationToken) -> std::io::Result<Self> {
        let (room, began) = (tempfile::tempdir()?, Instant::now());
        let (points, skipped, costs) = (Vec::new(), Vec::new(), Costs::new(Duration::ZERO));
        Ok(Self { order, stop, points, skipped, room, costs, tell, began })
    }

    /// Renders once, as `render` would, to the written PNG; `None` where it was stopped or time was up.
    pub(super) async fn render(&self, settings: Settings, goal: Goal) -> Result<Option<Job>, MeasureError> {
        let stop = self.stop.child_token();
        let job = RenderJob {
            goal,
            // Floats are what can be measured; beside bytes they cost next to nothing.
            pixels: PixelFormat::F32,
            workers: self.order.workers,
            threads: self.order.threads,
            // What is measured is looked at whole.
            scratch: Scratch { in_memory: u64::MAX, ..Scratch::default() },
            ..RenderJob::new(SceneSource::Prepared(Arc::clone(&self.order.scene)), settings)
        };
        let (tell, _progress) = watch::channel(Progress::default());
        let begun = Instant::now();
        let rendering = crate::farm::render(job, ListenAddr::Loopback, tell, stop.clone());
        tokio::pin!(rendering);
        let ended = tokio::select! {
            ended = &mut rendering => ended,
            () = self.time_up() => {
                stop.cancel();
                rendering.await
            }
        };
        let rendered = match ended {
            Ok(rendered) => rendered,
            Err(unfinished) if matches!(unfinished.error, RenderError::Cancelled) => return Ok(None),
            Err(unfinished) => return Err(unfinished.error.into()),
        };
        let traced = begun.elapsed();
        let file = self.room.path().join("picture.png");
        let (rendered, write) = blocking(move || -> std::io::Result<_> {
            let writing = Instant::now();
            if let Some(Pixels::F32(pixels)) = rendered.image.pixels() {
                let output = Output::plan(&file, Depth::Eight, settings.transfer).map_err(std::io::Error::other)?;
                let (width, height) = (settings.view.width(), settings.view.height());
                output.write(width, height, PixelsRef::F32(pixels)).map_err(std::io::Error::other)?;
            }
            Ok((rendered, writing.elapsed()))
        })
        .await??;
        let whole = self.order.read + self.order.build + traced + write;
        Ok(Some(Job { trace: rendered.trace, whole, rendered }))
    }

    /// Tells those who wait what comes next.
    pub(super) fn say(&self, what: String, expected: Duration, after: Duration) {
        self.tell.send_replace(Stage { what, began: self.began, since: Instant::now(), expected, after });
    }

    /// Whether there is time for what is expected to take so long.
    pub(super) fn has_time(&self, expected: Duration) -> bool {
        self.order.budget.is_none_or(|budget| self.began.elapsed().saturating_add(expected) <= budget)
    }

    /// Waits until the budget is used up.
    pub(super) async fn time_up(&self) {
        match self.order.budget.and_then(|budget| self.began.checked_add(budget)) {
            Some(deadline) => tokio::time::sleep_until(deadline.into()).await,
            None => std::future::pending().await,
        }
    }

    /// Every setting to be measured.
    pub(super) fn steps(&self) -> Vec<Step> {
        let mirrors = self.order.scene.scene().surfaces().iter().any(|s| s.reflect != 0.0);
        let shorter = mirrors.then_some((self.order.settings.max_depth, self.order.quality));
        sweep::steps(self.order.target, shorter, self.order.peers)
    }

    /// The reference: as given, or rendered; `None` where it was stopped before there was one.
    pub(super) async fn reference(&mut self) -> Result<Option<Reference>, MeasureError> {
        let base = self.order.settings;
        let uniform = |grid: u32| Settings { sampling: Sampling::Uniform { grid }, ..base };
        // The first render warms everything up; its time is only a first guess.
        let Some(first) = self.render(uniform(1), Goal::AsSet).await? else { return Ok(None) };
        self.costs = Costs::new(first.trace);
        if let Some(given) = self.order.reference.take() {
            return Ok(Some(given));
        }
        let (budget, target) = (self.order.budget, self.order.target);
        let mut blend = Blend::new((base.view.width(), base.view.height()));
        let mut wanted: Vec<u32> = sweep::first_grids(self.order.reference_samples, self.costs, budget).into();
        while !wanted.is_empty() {
            let grid = wanted.remove(0);
            let rest = wanted.iter().map(|&g| self.costs.expect_grid(g)).sum();
            let steps = self.steps();
            let after = steps.iter().map(|s| self.costs.expect_runs(s, self.order.repeat));
            let what = format!("reference, {grid}×{grid} samples a pixel");
            self.say(what, self.costs.expect_grid(grid), after.fold(rest, Duration::saturating_add));
            let Some(job) = self.render(uniform(grid), Goal::AsSet).await? else { break };
            self.costs.learn(&Step::Ours(Knob::Samples(grid)), job.trace);
            let pixels = pixels_of(job.rendered);
            blend = blocking(move || {
                blend.add(grid, pixels);
                blend
            })
            .await?;
            if wanted.is_empty()
                && self.order.reference_samples.is_none()
                && let Some(so_far) = blend.finest().zip(blend.own_error())
                && let Some(more) = sweep::more_grids(so_far, target, self.costs, (self.began.elapsed(), budget))
            {
                wanted.extend(more);
            }
        }
        Ok(blend.finish())
    }
}

/// Runs `work` off the async threads.
pub(super) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, RenderError> {
    tokio::task::spawn_blocking(work).await.map_err(|e| RenderError::Internal(e.to_string()))
}

/// The pixels of a render whose pixels are floats.
pub(super) fn pixels_of(rendered: Rendered) -> Vec<[f32; 3]> {
    match rendered.image.into_pixels() {
        Some(Pixels::F32(pixels)) => pixels,
        _ => Vec::new(),
    }
}
