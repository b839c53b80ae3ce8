//! Hands the tiles of a picture to workers and stitches what they return.

pub mod access;
mod farm;
pub mod fleet;
mod job;
pub mod journal;
pub mod measure;
mod plan;
pub mod povray;
mod queue;
mod scheduler;
#[doc(hidden)]
pub mod simulation;
pub mod web;

pub use farm::{Canvas, Farm, Film, OnDisk, Scratch, Strangers, Timing, render};
pub use job::{
    CheckedTile, Earlier, ListenAddr, Patience, Progress, RenderError, RenderJob, Rendered, SceneSource, TileSize,
    Unfinished, Verification, WorkerStats,
};
pub use plan::{Forecast, Goal};
pub use queue::{Keep, Orders, Queue, StoreError};
pub use tessera_proto::{PixelFormat, Pixels};
