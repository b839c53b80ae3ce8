//! Hands the tiles of a picture to workers and stitches what they return.

pub mod access;
mod columns;
mod config;
mod control;
mod error;
mod farm;
mod film;
pub mod fleet;
mod job;
pub mod journal;
pub mod measure;
pub mod open_files;
mod plan;
pub mod povray;
mod progress;
mod queue;
mod scheduler;
/// What the plan assumes, for whoever measures it anew.
#[doc(hidden)]
pub mod plan_model {
    pub use crate::plan::{MODEL, Model};
}
#[doc(hidden)]
pub mod simulation;
pub mod web;

pub use columns::columns;
pub use config::{ListenAddr, Patience, TileSize, Timing};
pub use error::RenderError;
pub use farm::{Farm, Strangers, render};
pub use film::{Canvas, Film, OnDisk, Scratch};
pub use job::{RenderJob, Rendered, SceneSource, Unfinished};
pub use plan::{Forecast, Goal};
pub use progress::{CheckedTile, Earlier, Progress, Verification, WorkerStats};
pub use queue::{Keep, Orders, Queue, StoreError, is_final, state_name};
pub use tessera_proto::{PixelFormat, Pixels};
