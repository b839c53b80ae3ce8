//! What the farm is asked for, and gives back.

use std::sync::Arc;
use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::scene::Scene;
use tessera_core::settings::{Pass, Settings};
use tessera_core::trace::{PreparedScene, RayCounts};
use tessera_proto::PixelFormat;
use tracing::Span;
use worker::{Exact, RendererFactory};

use crate::config::{Patience, TileSize, Timing};
use crate::error::RenderError;
use crate::film::{Canvas, Film, Scratch};
use crate::journal::{Head, Journal};
use crate::plan::{Forecast, Goal};
use crate::progress::{Earlier, Verification, WorkerStats};

/// The scene of a job.
#[derive(Clone, Debug)]
pub enum SceneSource {
    /// Resolved only: workers in this process prepare it once, when there are any.
    Resolved(Arc<Scene>),
    /// Already prepared; workers in this process share it as it is.
    Prepared(Arc<PreparedScene>),
}

impl SceneSource {
    /// The resolved scene.
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        match self {
            Self::Resolved(scene) => scene,
            Self::Prepared(prepared) => prepared.scene(),
        }
    }
}

/// One picture to render.
#[derive(Clone, Debug)]
pub struct RenderJob {
    /// What is seen.
    pub scene: SceneSource,
    /// How it is seen.
    pub settings: Settings,
    /// The pixels wanted, inside the view.
    pub region: Region,
    /// What pixels the output needs.
    pub pixels: PixelFormat,
    /// Edge of a tile.
    pub tile: TileSize,
    /// Workers started inside this process; 0 waits for others to connect.
    pub workers: usize,
    /// Threads of all workers in this process together; each has at least one.
    pub threads: usize,
    /// How good the picture is to be. Anything but [`Goal::AsSet`] needs adaptive sampling.
    pub goal: Goal,
    /// Share of the tiles that are rendered a second time elsewhere and compared, 0 to 1.
    pub verify: f64,
    /// How long to go on without any worker.
    pub patience: Patience,
    /// How long other things may take.
    pub timing: Timing,
    /// Where what is done is kept, if anywhere, and what an earlier run left there.
    pub journal: Option<Arc<Journal>>,
    /// Where the picture is while it is made, if it is large.
    pub scratch: Scratch,
    /// Time that passed before the render, where it counts against a limit.
    pub spent: Duration,
    /// Where others see the picture as it grows, if anybody looks.
    pub canvas: Option<Canvas>,
    /// What renders tiles in this process: the tracer, or in tests something else.
    pub factory: Arc<dyn RendererFactory>,
    /// What its spans are under, where they are recorded.
    pub span: Span,
}

impl RenderJob {
    /// The whole picture of `settings.view` in 8 bits, by two workers with every core.
    #[must_use]
    pub fn new(scene: SceneSource, settings: Settings) -> Self {
        let (x1, y1) = (settings.view.width(), settings.view.height());
        Self {
            scene,
            settings,
            region: Region { x0: 0, y0: 0, x1, y1 },
            pixels: PixelFormat::Rgb8,
            tile: TileSize::Auto,
            workers: 2,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            goal: Goal::AsSet,
            verify: 0.0,
            patience: Patience::default(),
            timing: Timing::default(),
            journal: None,
            scratch: Scratch::default(),
            spent: Duration::ZERO,
            canvas: None,
            factory: Arc::new(Exact),
            span: Span::none(),
        }
    }

    /// What its journal is of. Hashing a large scene takes a while.
    #[must_use]
    pub fn head(&self) -> Head {
        Head::new(self.scene.scene(), self.settings, self.region, self.pixels, self.goal).verified(self.verify > 0.0)
    }
}

/// A picture, whole or in part.
#[derive(Debug, PartialEq)]
pub struct Rendered {
    /// Where its pixels are in the view.
    pub region: Region,
    /// The pixels of `region`, black where not done.
    pub image: Film,
    /// Which parts are done; together they are `region` when the render succeeded.
    pub done: Vec<Region>,
    /// Rays of all parts.
    pub rays: RayCounts,
    /// What of all this an earlier run did.
    pub earlier: Earlier,
    /// Every worker that ever registered, in order of arrival.
    pub workers: Vec<WorkerStats>,
    /// Tiles that make up the picture.
    pub tiles: u64,
    /// From the first lease to the last pixel stitched.
    pub trace: Duration,
    /// How far the pixels are off; `None` under uniform sampling.
    pub error: Option<ErrorEstimate>,
    /// Whether the error asked for was reached; `None` where none was. Of a region, whether the whole reaches it.
    pub target_met: Option<bool>,
    /// The last pass that covers all pixels, where sampling was adaptive. Later ones may cover some.
    pub pass: Option<Pass>,
    /// What other errors would take, where that can be told.
    pub forecast: Option<Forecast>,
    /// Passes that the picture took, looks at parts of it included.
    pub passes: u32,
    /// Whether time was up before the goal was reached.
    pub timed_out: bool,
    /// Calls that were refused for want of the farm's token or a certificate.
    pub strangers: u64,
    /// What was rendered twice, and who lied.
    pub verification: Verification,
}

impl Rendered {
    /// Whether every pixel is done.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.done.iter().map(Region::area).sum::<u64>() == self.region.area()
    }
}

/// A render that did not finish, and what it has: nothing finished is lost.
#[derive(Debug, thiserror::Error)]
#[error("{error}")]
pub struct Unfinished {
    /// Why.
    #[source]
    pub error: RenderError,
    /// What was done until then; `None` where it never began.
    pub partial: Option<Box<Rendered>>,
}

impl From<RenderError> for Unfinished {
    fn from(error: RenderError) -> Self {
        Self { error, partial: None }
    }
}
