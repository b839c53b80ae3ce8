//! From an order to what was measured.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tessera_core::settings::{Quality, Settings};
use tessera_core::trace::PreparedScene;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::bench::Bench;
use super::pareto;
use super::point::Measured;
use super::reference::Reference;
use crate::error::RenderError;

/// What is to be measured.
#[derive(Debug)]
pub struct Order {
    /// The scene's name, for titles.
    pub name: String,
    /// The scene.
    pub scene: Arc<PreparedScene>,
    /// What all renders have in common; its sampling is not used.
    pub settings: Settings,
    /// The quality at which shorter paths are tried.
    pub quality: Quality,
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
    let mut bench = Bench::new(order, tell, stop)?;
    let reference = bench.reference().await?;
    let clamped = bench.order.peers || reference.as_ref().is_some_and(Reference::holds_codes);
    if let Some(reference) = &reference {
        bench.sweep(reference, clamped).await?;
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
