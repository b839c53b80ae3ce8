//! Renders every setting and holds it against the reference.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tempfile::TempDir;
use tessera_core::film::file::{Depth, Output};
use tessera_core::film::{Image, Metrics, PixelsRef};
use tessera_core::settings::{Sampling, Settings};
use tessera_core::trace::PreparedScene;
use tessera_proto::{PixelFormat, Pixels};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::knob::{Knob, Method};
use super::peer::{self, Exported};
use super::point::{Measured, Point, Predicted, Skipped};
use super::reference::{Blend, Reference};
use super::sweep::{self, Costs};
use super::{pareto, sweep::median};
use crate::plan::Goal;
use crate::{ListenAddr, Progress, RenderError, RenderJob, Rendered, SceneSource};

/// What is to be measured.
#[derive(Debug)]
pub struct Order {
    /// The scene's name, for titles.
    pub name: String,
    /// The scene.
    pub scene: Arc<PreparedScene>,
    /// What all renders have in common; its sampling is not used.
    pub settings: Settings,
    /// Workers inside this process.
    pub workers: usize,
    /// Threads of all of them together.
    pub threads: usize,
    /// How long reading the scene took.
    pub read: Duration,
    /// How long building structures took.
    pub build: Duration,
    /// The picture to measure against; it is rendered where none is given.
    pub reference: Option<Reference>,
    /// Samples a pixel of a rendered reference, at least; chosen by the target where not given.
    pub reference_samples: Option<u32>,
    /// The error that a recommendation is wanted for, in 8-bit steps.
    pub target: f64,
    /// Whether POV-Ray is measured too.
    pub peers: bool,
    /// How long all of it may take.
    pub budget: Option<Duration>,
    /// How often each setting is rendered; chosen by its time where not given.
    pub repeat: Option<u32>,
}

/// What is being done, for those who wait.
#[derive(Clone, Debug)]
pub struct Stage {
    /// In a few words.
    pub what: String,
    /// When all of it began.
    pub began: Instant,
    /// When this stage began.
    pub since: Instant,
    /// How long this stage is expected to take.
    pub expected: Duration,
    /// How long what follows is expected to take.
    pub after: Duration,
}

impl Stage {
    /// Nothing yet.
    #[must_use]
    pub fn start() -> Self {
        let now = Instant::now();
        Self { what: "first render".into(), began: now, since: now, expected: Duration::ZERO, after: Duration::ZERO }
    }

    /// Time to go at `now`, as far as can be told.
    #[must_use]
    pub fn left(&self, now: Instant) -> Duration {
        self.expected.saturating_sub(now - self.since).saturating_add(self.after)
    }

    /// The share that is done at `now`, as far as can be told.
    #[must_use]
    pub fn share(&self, now: Instant) -> f64 {
        let (gone, left) = ((now - self.began).as_secs_f64(), self.left(now).as_secs_f64());
        if gone + left > 0.0 { gone / (gone + left) } else { 0.0 }
    }
}

/// Why nothing could be measured.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A render failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Files that are needed on the way could not be written.
    #[error("cannot write temporary files: {0}")]
    Files(#[from] std::io::Error),
}

/// Measures. A cancelled `stop` ends it early, with what there is.
///
/// # Errors
/// When a render fails, or the system refuses temporary files.
pub async fn measure(
    order: Order,
    tell: watch::Sender<Stage>,
    stop: CancellationToken,
) -> Result<Measured, MeasureError> {
    let began = Instant::now();
    let room = tempfile::tempdir()?;
    let mut bench = Bench { order, tell, stop, began, room, skipped: Vec::new(), points: Vec::new(), costs: None };
    let reference = bench.reference().await?;
    let clamped = bench.order.peers || reference.as_ref().is_some_and(Reference::holds_codes);
    if let Some(reference) = &reference {
        let truth = Arc::new(in_range(reference.image.clone(), clamped));
        bench.sweep(reference, &truth, clamped).await?;
        if bench.order.peers {
            bench.peers(reference, &truth).await?;
        }
    }
    let interrupted = bench.stop.is_cancelled();
    let Bench { order, mut points, skipped, .. } = bench;
    let recommendation = pareto::conclude(&mut points, order.target);
    Ok(Measured {
        scene: order.name,
        settings: order.settings,
        workers: order.workers,
        threads: order.threads,
        read: order.read,
        build: order.build,
        target: order.target,
        reference,
        clamped,
        points,
        skipped,
        recommendation,
        interrupted,
    })
}

/// A render and its times.
struct Job {
    rendered: Rendered,
    trace: Duration,
    whole: Duration,
}

/// The state of a measurement.
struct Bench {
    order: Order,
    tell: watch::Sender<Stage>,
    stop: CancellationToken,
    began: Instant,
    room: TempDir,
    skipped: Vec<Skipped>,
    points: Vec<Point>,
    costs: Option<Costs>,
}

impl Bench {
    /// Renders once, as `render` would, to the written PNG; `None` where it was stopped or time was up.
    async fn render(&self, settings: Settings, goal: Goal) -> Result<Option<Job>, MeasureError> {
        let stop = self.stop.child_token();
        let job = RenderJob {
            goal,
            // Floats are what can be measured; beside bytes they cost next to nothing.
            pixels: PixelFormat::F32,
            workers: self.order.workers,
            threads: self.order.threads,
            ..RenderJob::new(SceneSource::Prepared(Arc::clone(&self.order.scene)), settings)
        };
        let (tell, _progress) = watch::channel(Progress::default());
        let begun = Instant::now();
        let rendering = crate::render(job, ListenAddr::Loopback, tell, stop.clone());
        tokio::pin!(rendering);
        let deadline = self.order.budget.and_then(|budget| self.began.checked_add(budget));
        let ended = tokio::select! {
            ended = &mut rendering => ended,
            () = until(deadline) => {
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
        let (file, transfer) = (self.room.path().join("picture.png"), settings.transfer);
        let (rendered, write) = blocking(move || {
            let writing = Instant::now();
            write(&file, &settings, transfer, &rendered).map(|()| (rendered, writing.elapsed()))
        })
        .await??;
        let whole = self.order.read + self.order.build + traced + write;
        Ok(Some(Job { trace: rendered.trace, whole, rendered }))
    }

    fn say(&self, what: String, expected: Duration, after: Duration) {
        self.tell.send_replace(Stage { what, began: self.began, since: Instant::now(), expected, after });
    }

    /// Whether there is time for what is expected to take so long.
    fn has_time(&self, expected: Duration) -> bool {
        self.order.budget.is_none_or(|budget| self.began.elapsed().saturating_add(expected) <= budget)
    }

    fn skip(&mut self, what: String, why: &str) {
        self.skipped.push(Skipped { what, why: why.into() });
    }

    /// The reference: as given, or rendered; `None` where it was stopped before there was one.
    async fn reference(&mut self) -> Result<Option<Reference>, MeasureError> {
        let base = self.order.settings;
        let uniform = |grid: u32| Settings { sampling: Sampling::Uniform { grid }, ..base };
        // The first render warms everything up; its time is only a first guess.
        let Some(first) = self.render(uniform(1), Goal::AsSet).await? else { return Ok(None) };
        let costs = *self.costs.insert(Costs::new(first.trace));
        if let Some(given) = self.order.reference.take() {
            return Ok(Some(given));
        }
        let (budget, target) = (self.order.budget, self.order.target);
        let settings_after = self.settings_cost(&costs);
        let mut blend = Blend::new((base.view.width(), base.view.height()));
        let first = sweep::first_grids(self.order.reference_samples, &costs, budget);
        let mut wanted: Vec<u32> = first.into();
        while !wanted.is_empty() {
            let grid = wanted.remove(0);
            let rest: Duration = wanted.iter().map(|&g| costs.expect_grid(g)).sum();
            let what = format!("reference, {grid}×{grid} samples a pixel");
            self.say(what, costs.expect_grid(grid), rest.saturating_add(settings_after));
            let Some(job) = self.render(uniform(grid), Goal::AsSet).await? else { break };
            let pixels = pixels_of(job.rendered);
            blend = blocking(move || {
                blend.add(grid, pixels);
                blend
            })
            .await?;
            if wanted.is_empty()
                && self.order.reference_samples.is_none()
                && let Some(so_far) = blend.finest().zip(blend.own_error())
                && let Some(more) = sweep::more_grids(so_far, target, &costs, (self.began.elapsed(), budget))
            {
                wanted.extend(more);
            }
        }
        Ok(blend.finish())
    }

    /// What all settings together are expected to take.
    fn settings_cost(&self, costs: &Costs) -> Duration {
        self.knobs().iter().map(|k| self.expected(costs, k)).fold(Duration::ZERO, Duration::saturating_add)
    }

    fn knobs(&self) -> Vec<Knob> {
        let mirrors = self.order.scene.scene().surfaces().iter().any(|s| s.reflect != 0.0);
        sweep::knobs(self.order.target, self.order.settings.max_depth, mirrors)
    }

    /// All runs of a setting.
    fn expected(&self, costs: &Costs, knob: &Knob) -> Duration {
        let once = costs.expect(knob);
        once.saturating_mul(sweep::runs(self.order.repeat, once))
    }

    async fn sweep(&mut self, reference: &Reference, truth: &Arc<Image>, clamped: bool) -> Result<(), MeasureError> {
        let Some(mut costs) = self.costs else { return Ok(()) };
        let knobs = self.knobs();
        for (i, knob) in knobs.iter().enumerate() {
            if self.stop.is_cancelled() {
                return Ok(());
            }
            if !sweep::worthwhile(knob, &self.points, self.order.target) {
                continue;
            }
            let name = knob.flags().join(" ");
            let expected = self.expected(&costs, knob);
            if !self.has_time(expected) {
                self.skip(name, "it would not fit into the budget");
                continue;
            }
            let after = knobs[i + 1..].iter().filter(|k| sweep::worthwhile(k, &self.points, self.order.target));
            let after = after.map(|k| self.expected(&costs, k)).fold(Duration::ZERO, Duration::saturating_add);
            self.say(name.clone(), expected, after.saturating_add(self.peers_cost(&costs)));
            match self.try_knob(knob, reference, truth, clamped).await? {
                Some(point) => {
                    costs.learn(knob, point.trace);
                    self.points.push(point);
                }
                None if !self.stop.is_cancelled() => self.skip(name, "the budget was used up while it rendered"),
                None => {}
            }
        }
        self.costs = Some(costs);
        Ok(())
    }

    /// Renders a setting as often as makes sense.
    async fn try_knob(
        &self,
        knob: &Knob,
        reference: &Reference,
        truth: &Arc<Image>,
        clamped: bool,
    ) -> Result<Option<Point>, MeasureError> {
        let (settings, goal) = knob.apply(&self.order.settings);
        let Some(first) = self.render(settings, goal).await? else { return Ok(None) };
        let (mut trace, mut whole) = (vec![first.trace], vec![first.whole]);
        for _ in 1..sweep::runs(self.order.repeat, first.trace) {
            if !self.has_time(first.trace) {
                break;
            }
            // A repetition that was stopped takes nothing from what is there.
            let Some(again) = self.render(settings, goal).await? else { break };
            trace.push(again.trace);
            whole.push(again.whole);
        }
        let rays = first.rendered.rays.into();
        let predicted = first.rendered.error.map(|error| Predicted { rmse: error.rmse(), worst: error.worst_pixel() });
        let size = (settings.view.width(), settings.view.height());
        let image = image_of(size, pixels_of(first.rendered))?;
        let metrics = judge(Arc::clone(truth), in_range(image, clamped)).await?;
        Ok(Some(Point {
            method: knob.method(),
            value: knob.value(),
            knob: Some(*knob),
            flags: knob.flags(),
            runs: trace.len() as u32,
            trace: median(trace),
            whole: median(whole),
            rays: Some(rays),
            metrics,
            predicted,
            beyond_reference: reference.cannot_tell(metrics.rmse),
            front: false,
        }))
    }

    /// What POV-Ray is expected to take, if it is asked.
    fn peers_cost(&self, costs: &Costs) -> Duration {
        let all: f64 = peer::LADDER.iter().map(|rung| rung.cost).sum();
        if self.order.peers { costs.expect_times(all) } else { Duration::ZERO }
    }

    /// Measures POV-Ray. That it fails is told, and ends nothing.
    async fn peers(&mut self, reference: &Reference, truth: &Arc<Image>) -> Result<(), MeasureError> {
        let Some(costs) = self.costs else { return Ok(()) };
        let folder = self.room.path().join("povray");
        let (scene, settings, threads) = (Arc::clone(&self.order.scene), self.order.settings, self.order.threads);
        let exported = blocking(move || {
            std::fs::create_dir(&folder)?;
            Exported::write(scene.scene(), &settings, threads, &folder)
        })
        .await??;
        // How many times as long as thought it takes is learnt on the way.
        let mut learnt = 1.0;
        for (i, rung) in peer::LADDER.iter().enumerate() {
            let name = format!("POV-Ray {}", rung.value());
            let expect = |cost: f64| costs.expect_times(learnt * cost);
            if self.stop.is_cancelled() {
                return Ok(());
            }
            if !self.has_time(expect(rung.cost)) {
                self.skip(name, "it would not fit into the budget");
                continue;
            }
            self.say(name.clone(), expect(rung.cost), expect(peer::LADDER[i + 1..].iter().map(|r| r.cost).sum()));
            let mut runs = Vec::new();
            let mut wanted = 1;
            while runs.len() < wanted {
                let deadline = self.order.budget.and_then(|budget| self.began.checked_add(budget));
                let ran = tokio::select! {
                    ran = exported.run(rung) => ran,
                    () = self.stop.cancelled() => return Ok(()),
                    () = until(deadline) => {
                        if runs.is_empty() {
                            self.skip(name.clone(), "the budget was used up while it rendered");
                        }
                        break;
                    }
                };
                match ran {
                    Ok(ran) => {
                        wanted = sweep::runs(self.order.repeat, ran.whole) as usize;
                        runs.push(ran);
                    }
                    Err(e) => {
                        self.skip(name.clone(), &e.to_string());
                        break;
                    }
                }
            }
            let trace = median(runs.iter().map(|r| r.trace).collect());
            let whole = median(runs.iter().map(|r| r.whole).collect());
            let count = runs.len() as u32;
            let Some(last) = runs.pop() else { continue };
            learnt = trace.as_secs_f64() / costs.expect_times(rung.cost).as_secs_f64();
            let metrics = judge(Arc::clone(truth), last.image).await?;
            self.points.push(Point {
                method: Method::PovRay,
                value: rung.value(),
                knob: None,
                flags: rung.flags.iter().map(|f| (*f).to_owned()).collect(),
                trace,
                whole,
                runs: count,
                rays: last.rays,
                metrics,
                predicted: None,
                beyond_reference: reference.cannot_tell(metrics.rmse),
                front: false,
            });
        }
        Ok(())
    }
}

/// Waits for a time, or for ever.
async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => tokio::time::sleep_until(deadline.into()).await,
        None => std::future::pending().await,
    }
}

/// Runs `work` off the async threads.
async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, RenderError> {
    tokio::task::spawn_blocking(work).await.map_err(|e| RenderError::Internal(e.to_string()))
}

async fn judge(truth: Arc<Image>, test: Image) -> Result<Metrics, RenderError> {
    blocking(move || Metrics::of_radiance(&truth, &test)).await
}

fn write(
    file: &Path,
    settings: &Settings,
    transfer: tessera_core::settings::Transfer,
    rendered: &Rendered,
) -> std::io::Result<()> {
    let Pixels::F32(pixels) = &rendered.image else { return Err(std::io::Error::other("pixels are not floats")) };
    let output = Output::plan(file, Depth::Eight, transfer).map_err(std::io::Error::other)?;
    let (width, height) = (settings.view.width(), settings.view.height());
    output.write(width, height, PixelsRef::F32(pixels)).map_err(std::io::Error::other)
}

fn pixels_of(rendered: Rendered) -> Vec<[f32; 3]> {
    match rendered.image {
        Pixels::F32(pixels) => pixels,
        // Floats were asked for.
        _ => Vec::new(),
    }
}

fn image_of((width, height): (u32, u32), pixels: Vec<[f32; 3]>) -> Result<Image, RenderError> {
    Image::new(width, height, pixels).ok_or_else(|| RenderError::Internal("a picture is not whole".into()))
}

/// The picture as codes could hold it, where that is what is compared.
fn in_range(image: Image, clamped: bool) -> Image {
    if clamped { image.map(|x| x.clamp(0.0, 1.0)) } else { image }
}
