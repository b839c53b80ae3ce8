//! How far a render is, and who did what of it.

use std::time::Duration;

use tessera_core::film::Region;
use tessera_core::trace::RayCounts;

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
