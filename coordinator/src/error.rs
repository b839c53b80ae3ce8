//! Why a render ends without its picture.

use std::net::SocketAddr;
use std::time::Duration;

use tessera_core::film::Region;
use tessera_core::trace::PrepareError;

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
