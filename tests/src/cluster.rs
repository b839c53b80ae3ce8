//! A farm in one line: a coordinator and workers on loopback.
//!
//! ```no_run
//! # use tessera_tests::{cluster::Cluster, generate};
//! let rendered = Cluster::of(generate::demo().scene().unwrap()).size(64, 48).render();
//! ```

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use coordinator::{
    Farm, ListenAddr, PixelFormat, Progress, RenderJob, Rendered, SceneSource, TileSize, Unfinished, WorkerStats,
};
use tessera_core::film::Region;
use tessera_core::scene::Scene;
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use worker::RendererFactory;

/// A job to be rendered by a farm of its own; two workers of one thread unless told otherwise.
#[derive(Clone, Debug)]
pub struct Cluster {
    /// The job, for whatever has no method here.
    pub job: RenderJob,
}

impl Cluster {
    /// `scene` at 160x120, in floats, by two workers.
    ///
    /// # Panics
    /// Never: the settings are in range.
    #[must_use]
    pub fn of(scene: Scene) -> Self {
        let settings = Settings {
            view: View::new(160, 120, 1.0, 1.0).expect("in range"),
            max_depth: 6,
            sampling: Sampling::Uniform { grid: 1 },
            transfer: Transfer::Srgb,
        };
        let mut job = RenderJob::new(SceneSource::Resolved(Arc::new(scene)), settings);
        job.threads = 2;
        job.pixels = PixelFormat::F32;
        Self { job }
    }

    /// A picture of `width` × `height` pixels.
    ///
    /// # Panics
    /// When that is out of range.
    #[must_use]
    pub fn size(mut self, width: u32, height: u32) -> Self {
        self.job.settings.view = View::new(width, height, 1.0, 1.0).expect("a size in range");
        self.job.region = Region { x0: 0, y0: 0, x1: width, y1: height };
        self
    }

    /// Workers in this process, and threads of each.
    #[must_use]
    pub fn workers(mut self, workers: usize, threads: usize) -> Self {
        self.job.workers = workers;
        self.job.threads = workers * threads;
        self
    }

    /// Tiles of `edge` pixels instead of by cost.
    #[must_use]
    pub fn tile(mut self, edge: u32) -> Self {
        self.job.tile = TileSize::Edge(edge);
        self
    }

    /// Tiles in this process are rendered by `factory`.
    #[must_use]
    pub fn factory(mut self, factory: impl RendererFactory + 'static) -> Self {
        self.job.factory = Arc::new(factory);
        self
    }

    /// Silence is noticed a few times sooner than usual.
    #[must_use]
    pub fn nervous(mut self) -> Self {
        self.job.timing.beat = Duration::from_millis(50);
        self.job.timing.suspect_after = Duration::from_millis(500);
        self.job.timing.dead_after = Duration::from_millis(1500);
        self
    }

    /// Starts the farm; must be called inside a runtime.
    ///
    /// # Panics
    /// When there is no loopback to listen on.
    pub async fn start(self) -> Running {
        self.start_at(ListenAddr::Loopback).await
    }

    /// As [`Cluster::start`], listening there.
    ///
    /// # Panics
    /// When that is not to be had.
    pub async fn start_at(self, listen: ListenAddr) -> Running {
        self.start_on(Farm::bind(listen).await.expect("a place to listen"))
    }

    /// As [`Cluster::start`], on a farm that listens already.
    #[must_use]
    pub fn start_on(self, farm: Farm) -> Running {
        let (addr, cancel) = (farm.addr(), CancellationToken::new());
        let (sender, progress) = watch::channel(Progress::default());
        let render = farm.render(self.job, sender, cancel.clone());
        Running { addr, progress, cancel, render: tokio::spawn(render) }
    }

    /// Renders on a runtime of its own.
    ///
    /// # Errors
    /// As the render ends.
    ///
    /// # Panics
    /// When there is no runtime to be had.
    pub fn render(self) -> Result<Rendered, Unfinished> {
        let runtime = tokio::runtime::Runtime::new().expect("a runtime");
        runtime.block_on(async { self.start().await.end().await })
    }
}

impl Cluster {
    /// As [`Cluster::render`], however long it takes.
    ///
    /// # Errors
    /// As the render ends.
    ///
    /// # Panics
    /// When there is no runtime to be had.
    pub fn render_unhurried(self) -> Result<Rendered, Unfinished> {
        let runtime = tokio::runtime::Runtime::new().expect("a runtime");
        runtime.block_on(async {
            let Running { render, progress, .. } = self.start().await;
            let end = render.await.expect("the render panicked");
            drop(progress);
            end
        })
    }
}

/// A farm at work.
#[derive(Debug)]
pub struct Running {
    /// Where workers connect.
    pub addr: SocketAddr,
    /// How far it is.
    pub progress: watch::Receiver<Progress>,
    /// Stops it.
    pub cancel: CancellationToken,
    render: JoinHandle<Result<Rendered, Unfinished>>,
}

/// Longer than anything here takes: what is not there by then never comes.
const NEVER: Duration = Duration::from_secs(60);

impl Running {
    /// Waits until `so` holds.
    ///
    /// # Panics
    /// When it does not within a minute, or the render ends before.
    pub async fn until(&mut self, so: impl FnMut(&Progress) -> bool) {
        let seen = tokio::time::timeout(NEVER, self.progress.wait_for(so)).await;
        let met = seen.expect("it does not come to that").is_ok();
        assert!(met, "the render ended before");
    }

    /// How a worker is doing, in the order of their arrival.
    ///
    /// # Panics
    /// When there is none of that number.
    #[must_use]
    pub fn worker(&self, number: usize) -> WorkerStats {
        self.progress.borrow().workers[number].clone()
    }

    /// Waits for the end.
    ///
    /// # Errors
    /// As the render ends.
    ///
    /// # Panics
    /// When it does not end within a minute, or panics.
    pub async fn end(self) -> Result<Rendered, Unfinished> {
        let end = tokio::time::timeout(NEVER, self.render).await.expect("the render hangs");
        end.expect("the render panicked")
    }
}
