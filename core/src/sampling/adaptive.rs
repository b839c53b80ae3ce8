//! Adaptive sampling of regions.

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
                // What is lost is lost for good: at most its bound, and half of it on average.
                let variance = p.variance + p.faint * p.faint / 3.0;
                errors[at] = variance.sqrt() as f32;
                error.add_pixel(variance);
            }
        }
    }
    (Tile { region, pixels, error }, errors, counts)
}
