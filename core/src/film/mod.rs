//! The image plane, tiles, pictures, files.

pub mod encode;
mod error;
mod false_colour;
pub mod file;
mod flip;
mod image;
mod metrics;
mod plane;
mod region;
pub mod transfer;

pub use error::{ErrorEstimate, Sum};
pub use false_colour::{FalseColour, differences};
pub use image::{Image, PixelsRef, pixels_sha256};
pub use metrics::Metrics;
pub use plane::PlanePoint;
pub(crate) use plane::{GRID, UNIT};
pub use region::Region;

/// A rendered part of a picture: linear radiance, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Which pixels these are.
    pub region: Region,
    /// `region.width() * region.height()` pixels, linear and unclamped.
    pub pixels: Vec<[f32; 3]>,
    /// How far they are from the image model's.
    pub error: ErrorEstimate,
}
