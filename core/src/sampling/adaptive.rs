//! Adaptive sampling of regions, towards a tolerance.
//!
//! The integrand is deterministic and smooth but for edges: outlines of objects, of shadows, and
//! their mirror images. So the error of a pixel is what is not known about edges in it, and
//! samples go where that is much. In the order of the work, and of the files:
//!
//! - [`super::corners`]: every pixel's corners, followed to their ends and shared by four pixels.
//! - [`super::small`], [`super::shadow`], [`super::feature`]: what is smaller than a pixel and
//!   could be missed by the corners, from projected outlines.
//! - [`super::part`]: radiance as a sum whose summands have few edges each.
//! - [`super::side`], [`super::outline`]: where edges cross the sides of cells.
//! - [`super::cell`], [`super::curve`]: areas from crossings, and the variance of their errors.
//! - [`super::block`]: which cells are refined, until every part of a pixel's error is within the
//!   tolerance.
//!
//! The estimate of a pixel's error is the sum of its parts' variances, taken as independent. Each
//! is what is in doubt (a contrast) times how much of it (an area), with shares found by
//! comparison with references of 1,024 samples a pixel over scenes of many kinds.

use rayon::prelude::*;

use super::block::{self, Pixel};
use super::corners::Corners;
use crate::film::{ErrorEstimate, Region, Tile};
use crate::trace::{RayCounts, Tracer};

/// Pixels along the edge of the blocks that threads take.
const BLOCK: u32 = 32;
/// Pixels along the edge of the pieces of a region whose corners are kept at a time.
const PIECE: u32 = 128;
/// Paths are not followed where what they could still add is below this share of the tolerance.
const FAINT: f64 = 0.25;

/// Renders `region`, with the standard deviation of each pixel's error.
pub(crate) fn render(tracer: &Tracer, region: Region, tolerance: f64) -> (Tile, Vec<f32>, RayCounts) {
    let mut pixels = vec![[0.0; 3]; region.area() as usize];
    let mut errors = vec![0.0; region.area() as usize];
    let mut error = ErrorEstimate::default();
    let mut counts = RayCounts::default();
    let least = FAINT * tolerance / tracer.brightest();
    for piece in region.blocks(PIECE) {
        let corners = Corners::new(tracer, piece, least);
        counts += corners.counts;
        let done: Vec<(Region, (Vec<Pixel>, RayCounts))> =
            piece.blocks(BLOCK).into_par_iter().map(|b| (b, block::render(tracer, &corners, b, tolerance))).collect();
        for (b, (part, c)) in done {
            counts += c;
            for (k, p) in part.iter().enumerate() {
                let (i, j) = (k as u32 % b.width(), k as u32 / b.width());
                let (x, y) = (b.x0 - region.x0 + i, b.y0 - region.y0 + j);
                let at = y as usize * region.width() as usize + x as usize;
                pixels[at] = p.value.to_array().map(|c| c as f32);
                errors[at] = p.error.variance().sqrt() as f32;
                error.add(&p.error);
            }
        }
    }
    (Tile { region, pixels, error }, errors, counts)
}
