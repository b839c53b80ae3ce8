//! Settings tried one after another.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use tessera_core::film::{Image, Metrics, pixels_sha256};
use tessera_proto::Pixels;

use super::bench::{Bench, Job, blocking, pixels_of};
use super::knob::{Knob, Method};
use super::peer::{Exported, PeerError, Ran, Rung};
use super::point::{Point, Predicted, Skipped};
use super::reference::Reference;
use super::run::MeasureError;
use super::sweep::{self, Step, median};
use crate::error::RenderError;

/// What a setting came to.
enum Tried {
    Point(Box<Point>),
    /// Nothing, and why.
    Left(String),
    /// Nothing, for a signal came.
    Stopped,
}

/// The pictures so far, by hash: the setting that gave each.
#[derive(Debug, Default)]
struct Pictures {
    by_hash: HashMap<String, String>,
    /// The depth beyond which no path goes.
    deepest: Option<String>,
}

/// What pictures are held against, and how.
struct Judge<'a> {
    reference: &'a Reference,
    truth: Arc<Image>,
    clamped: bool,
}

impl Judge<'_> {
    async fn judge(&self, test: Image) -> Result<Metrics, RenderError> {
        let (truth, test) = (Arc::clone(&self.truth), in_range(test, self.clamped));
        blocking(move || Metrics::of_radiance(&truth, &test)).await
    }
}

/// The picture as codes could hold it, where that is what is compared.
fn in_range(image: Image, clamped: bool) -> Image {
    if clamped { image.map(|x| x.clamp(0.0, 1.0)) } else { image }
}

/// The shortest and the longest of several times.
fn spread(times: &[Duration]) -> (Duration, Duration) {
    let (least, most) = (times.iter().min(), times.iter().max());
    (least.copied().unwrap_or_default(), most.copied().unwrap_or_default())
}

const USED_UP: &str = "the budget was used up while they rendered";

impl Bench {
    /// Measures every setting there is time for.
    pub(super) async fn sweep(&mut self, reference: &Reference, clamped: bool) -> Result<(), MeasureError> {
        let truth = Arc::new(in_range(reference.image.clone(), clamped));
        let judge = Judge { reference, truth, clamped };
        let steps = self.steps();
        let mut exported = None;
        let mut pictures = Pictures::default();
        for (i, step) in steps.iter().enumerate() {
            if self.stop.is_cancelled() {
                return Ok(());
            }
            let worthwhile = |s: &&Step| sweep::worthwhile(s, &self.points, self.order.target);
            if !worthwhile(&step) {
                continue;
            }
            let expect = |s: &Step| self.costs.expect_runs(s, self.order.repeat);
            let (name, expected) = (step.name(), expect(step));
            // One run tells as much as several, if there is no time for them.
            if !self.has_time(self.costs.expect(step)) {
                self.skipped.push(Skipped { what: name, why: "they do not fit into the budget".into() });
                continue;
            }
            let after = steps[i + 1..].iter().filter(worthwhile).map(expect);
            self.say(name.clone(), expected, after.fold(Duration::ZERO, Duration::saturating_add));
            let tried = match step {
                Step::Ours(knob) => self.try_new(knob, &judge, &mut pictures).await?,
                Step::PovRay(rung) => {
                    if exported.is_none() {
                        exported = Some(self.export().await?);
                    }
                    match &exported {
                        Some(exported) => self.try_povray(rung, exported, &judge).await?,
                        None => Tried::Stopped,
                    }
                }
            };
            match tried {
                Tried::Point(point) => {
                    self.costs.learn(step, point.trace);
                    self.points.push(*point);
                }
                Tried::Left(why) => self.skipped.push(Skipped { what: name, why }),
                Tried::Stopped => return Ok(()),
            }
        }
        Ok(())
    }

    /// Renders a setting of this program, unless it gives a picture that another one gave.
    async fn try_new(&self, knob: &Knob, judge: &Judge<'_>, pictures: &mut Pictures) -> Result<Tried, MeasureError> {
        // Where a path more changed nothing, no path is longer.
        if let (Knob::MaxDepth(..), Some(same)) = (knob, &pictures.deepest) {
            return Ok(Tried::Left(format!("they give the picture of {same}")));
        }
        let (settings, goal) = knob.apply(&self.order.settings);
        let Some(first) = self.render(settings, goal).await? else { return Ok(self.nothing()) };
        let hash = match first.rendered.image.pixels() {
            Some(Pixels::F32(pixels)) => pixels_sha256(pixels),
            _ => String::new(),
        };
        let name = knob.flags().join(" ");
        if let Some(same) = pictures.by_hash.get(&hash) {
            if matches!(knob, Knob::MaxDepth(..)) && same.starts_with("--max-depth") {
                pictures.deepest = Some(same.clone());
            }
            return Ok(Tried::Left(format!("they give the picture of {same}")));
        }
        pictures.by_hash.insert(hash, name);
        self.try_ours(knob, first, judge).await
    }

    /// What nothing became of, because a signal came or the budget was used up.
    fn nothing(&self) -> Tried {
        if self.stop.is_cancelled() { Tried::Stopped } else { Tried::Left(USED_UP.into()) }
    }

    /// Renders a setting of this program, of which there is a first picture, as often as makes sense.
    async fn try_ours(&self, knob: &Knob, first: Job, judge: &Judge<'_>) -> Result<Tried, MeasureError> {
        let (settings, goal) = knob.apply(&self.order.settings);
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
        let predicted = first.rendered.error.map(|error| Predicted { rmse: error.rmse(), upper: error.interval().1 });
        let (width, height) = (settings.view.width(), settings.view.height());
        let image = Image::new(width, height, pixels_of(first.rendered));
        let image = image.ok_or_else(|| RenderError::Internal("a picture is not whole".into()))?;
        let metrics = judge.judge(image).await?;
        Ok(Tried::Point(Box::new(Point {
            method: knob.method(),
            value: knob.value(),
            flags: knob.flags(),
            runs: trace.len() as u32,
            spread: spread(&trace),
            trace: median(trace),
            whole: median(whole),
            rays: Some(rays),
            metrics,
            predicted,
            beyond_reference: judge.reference.cannot_tell(metrics.rmse),
            front: false,
        })))
    }

    /// Writes the scene for POV-Ray.
    async fn export(&self) -> Result<Exported, MeasureError> {
        let folder = self.room.path().join("povray");
        let (scene, settings, threads) = (Arc::clone(&self.order.scene), self.order.settings, self.order.threads);
        let written = blocking(move || {
            std::fs::create_dir(&folder)?;
            Exported::write(scene.scene(), &settings, threads, &folder)
        });
        Ok(written.await??)
    }

    /// Lets POV-Ray render a setting as often as makes sense. That it fails ends nothing.
    async fn try_povray(&self, rung: &Rung, exported: &Exported, judge: &Judge<'_>) -> Result<Tried, MeasureError> {
        let mut runs: Vec<Ran> = Vec::new();
        loop {
            let ran: Option<Result<Ran, PeerError>> = tokio::select! {
                ran = exported.run(rung) => Some(ran),
                () = self.stop.cancelled() => None,
                () = self.time_up() => None,
            };
            match ran {
                Some(Ok(ran)) => runs.push(ran),
                Some(Err(e)) if runs.is_empty() => return Ok(Tried::Left(e.to_string())),
                Some(Err(_)) | None => break,
            }
            let whole = runs[0].whole;
            if runs.len() >= sweep::runs(self.order.repeat, whole) as usize || !self.has_time(whole) {
                break;
            }
        }
        let traces: Vec<Duration> = runs.iter().map(|r| r.trace).collect();
        let (spread, trace) = (spread(&traces), median(traces));
        let whole = median(runs.iter().map(|r| r.whole).collect());
        let count = runs.len() as u32;
        let Some(last) = runs.pop() else { return Ok(self.nothing()) };
        let metrics = judge.judge(last.image).await?;
        Ok(Tried::Point(Box::new(Point {
            method: Method::PovRay,
            value: rung.value(),
            flags: rung.flags.iter().map(|f| (*f).to_owned()).collect(),
            trace,
            spread,
            whole,
            runs: count,
            rays: last.rays,
            metrics,
            predicted: None,
            beyond_reference: judge.reference.cannot_tell(metrics.rmse),
            front: false,
        })))
    }
}
