//! What the farm is asked for, says on the way, and gives back.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::scene::Scene;
use tessera_core::settings::{Pass, Settings};
use tessera_core::trace::{PrepareError, PreparedScene, RayCounts};
use tessera_proto::PixelFormat;
use tracing::Span;
use worker::{Exact, RendererFactory};

use crate::farm::{Canvas, Film, Scratch, Timing};
use crate::journal::Journal;
use crate::plan::{Forecast, Goal};

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

/// Edge of a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TileSize {
    /// By measured cost.
    #[default]
    Auto,
    /// This many pixels, 1 to [`TileSize::MAX_EDGE`]; larger is taken as that.
    Edge(u32),
}

impl TileSize {
    /// The largest edge of a tile in pixels; its pixels fit one message in every format.
    pub const MAX_EDGE: u32 = 256;
}

/// Where workers are awaited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ListenAddr {
    /// 127.0.0.1, a free port: workers of this machine only.
    #[default]
    Loopback,
    /// This address; port 0 is a free one.
    Socket(SocketAddr),
}

/// How long a render goes on without any worker; [`Duration::MAX`] is for ever.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// Before the first one came.
    pub first: Duration,
    /// After the last one was lost.
    pub lost: Duration,
}

impl Default for Patience {
    /// Half a minute for the first, five after one was lost: machines start again in that time.
    fn default() -> Self {
        Self { first: Duration::from_secs(30), lost: Duration::from_secs(300) }
    }
}

impl From<Duration> for Patience {
    /// The same in both cases.
    fn from(time: Duration) -> Self {
        Self { first: time, lost: time }
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
}

/// How far a render is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Passes begun, looks at parts of the picture included.
    pub pass: u32,
    /// Whether the pass at hand is such a look.
    pub is_look: bool,
    /// The share of the render that is done, as far as can be told: it never falls.
    pub share: f64,
    /// Time to go, as far as can be told.
    pub remaining: Option<Duration>,
    /// Tiles of the pass that are done.
    pub tiles_done: u64,
    /// Tiles of it in all: an estimate until the end where tiles are sized by cost.
    pub tiles_total: u64,
    /// Pixels of the pass that are done.
    pub pixels_done: u64,
    /// Pixels of it in all.
    pub pixels_total: u64,
    /// Rays of the tiles stitched.
    pub rays: RayCounts,
    /// What of all this an earlier run did.
    pub earlier: Earlier,
    /// Estimated error (RMSE, as a fraction of full scale) of what is done, where it is estimated.
    pub error: Option<f64>,
    /// Every worker that ever registered, in order of arrival.
    pub workers: Vec<WorkerStats>,
    /// Since this run's render began.
    pub elapsed: Duration,
}

/// What was taken from a journal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Earlier {
    /// Tiles of all passes.
    pub tiles: u64,
    /// Pixels of the pass at hand.
    pub pixels_of_pass: u64,
    /// Rays of all passes.
    pub rays: RayCounts,
}

/// What one worker did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorkerStats {
    /// Its name, unique in this render.
    pub name: String,
    /// Its threads.
    pub threads: u32,
    /// Where it connected from.
    pub address: String,
    /// Whether it is connected now.
    pub connected: bool,
    /// Tiles it holds now: being rendered, or next to be.
    pub holds: usize,
    /// Tiles of it that are in the picture.
    pub tiles: u64,
    /// Pixels of it that are in the picture.
    pub pixels: u64,
    /// Rays of those tiles.
    pub rays: RayCounts,
    /// Time it spent rendering them.
    pub busy: Duration,
    /// Tiles it was given and did not deliver: failed, late or lost with it.
    pub lost: u64,
    /// Tiles of it that were rendered again elsewhere and found to be the same.
    pub verified: u64,
    /// Why it left, where it left before the end.
    pub left: Option<String>,
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

/// What came of rendering tiles twice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verification {
    /// The share of tiles that was asked for, 0 to 1.
    pub share: f64,
    /// Every tile that was compared, in the order of the results.
    pub checks: Vec<CheckedTile>,
    /// Workers whose pixels were not the scene's.
    pub thrown_out: Vec<String>,
    /// Tiles of theirs that were rendered again.
    pub redone: u64,
}

/// A tile that was rendered twice.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedTile {
    /// Its pixels.
    pub region: Region,
    /// Who delivered it.
    pub maker: String,
    /// Who rendered it again; `None` is the coordinator itself.
    pub checker: Option<String>,
    /// Whether both gave the same bits.
    pub agreed: bool,
}

impl Rendered {
    /// Whether every pixel is done.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.done.iter().map(Region::area).sum::<u64>() == self.region.area()
    }
}

/// Why a render ended without its picture.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The address cannot be listened on.
    #[error("cannot listen on {addr}: {source}")]
    Listen {
        /// The address asked for.
        addr: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// The scene cannot be traced under these settings.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The region reaches outside the picture.
    #[error("the region {},{} to {},{} reaches outside the picture", .0.x0, .0.y0, .0.x1, .0.y1)]
    Region(Region),
    /// Nobody was there to render for too long.
    #[error("no worker for {} s: {}{}", .waited.as_secs(), if *.ever { "all were lost" } else { "none came" },
        .last.as_ref().map(|l| format!("; the last: {l}")).unwrap_or_default())]
    NoWorkers {
        /// How long nobody was there.
        waited: Duration,
        /// Whether there had been a worker before.
        ever: bool,
        /// Why the last one left.
        last: Option<String>,
    },
    /// A tile failed wherever it was tried.
    #[error("tile {},{} to {},{} failed on {attempts} workers; last: {cause}", .region.x0, .region.y0, .region.x1, .region.y1)]
    Tile {
        /// The tile's pixels.
        region: Region,
        /// How often it was tried.
        attempts: u32,
        /// The last failure.
        cause: String,
    },
    /// The picture does not fit in memory.
    #[error("there is no memory for a picture of {0} pixels")]
    Memory(u64),
    /// A large picture's pixels cannot be kept on disk while they are made.
    #[error("the picture is too large for memory, and its pixels cannot be kept in '{path}' meanwhile: {1}; make room there, or choose another place for the output", path = .0.display())]
    Scratch(std::path::PathBuf, std::io::Error),
    /// What an earlier run did cannot be read any more.
    #[error("what an earlier run did cannot be read: {0}; --restart begins anew")]
    Journal(std::io::Error),
    /// The caller asked to stop.
    #[error("stopped")]
    Cancelled,
    /// A defect of this program.
    #[error("internal error: {0}")]
    Internal(String),
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
