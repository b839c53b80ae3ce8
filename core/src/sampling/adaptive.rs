//! Adaptive sampling of regions, towards a tolerance.
//!
//! The integrand is deterministic and smooth but for edges: outlines of objects, of shadows, and
//! their mirror images. So the error of a pixel is what is not known about edges in it, and
//! samples go where that is much. In the order of the work, and of the files:
//!
//! - [`super::corners`]: every pixel's corners, followed to their ends and shared by four pixels.
//! - [`super::small`], [`super::shadow`]: what is smaller than a pixel and could be missed by the
//!   corners, from projected outlines.
//! - [`super::gaps`]: where light may pass between shadows.
//! - [`super::difference`]: of what the corners see, that which differs and is worth a look.
//! - [`super::shape`], [`super::strata`]: exact areas of objects seen directly.
//! - [`super::fit`]: single edges, by bisection.
//! - [`super::cells`], [`super::estimate`], [`super::cuts`]: all else, by cells that are halved where their corners
//!   differ; what these tell, and which of them are cut.
//! - [`super::block`], [`super::rounds`], [`super::work`]: which of these a pixel takes, and when it
//!   is done.
//!
//! A pixel is done when what more rays would take off its error's variance is worth less than
//! they cost: limits rise with the rays spent, unless every pixel is to keep to the tolerance.

use rayon::prelude::*;

use super::block::{self, Pixel};
use super::corners::Corners;
use crate::film::{ErrorEstimate, Region, Tile};
use crate::trace::{RayCounts, Tracer, WaveScratch};

/// Pixels along the edge of the blocks that threads take.
const BLOCK: u32 = 32;
/// Pixels along the edge of the pieces of a region whose corners are kept at a time.
const PIECE: u32 = 128;
/// Paths are not followed where what they could still add is below this share of the tolerance.
const FAINT: f64 = 0.25;

/// Renders `region`, with the standard deviation of each pixel's error.
pub(crate) fn render(
    tracer: &Tracer,
    region: Region,
    tolerance: f64,
    every_pixel: bool,
) -> (Tile, Vec<f32>, RayCounts) {
    let mut pixels = vec![[0.0; 3]; region.area() as usize];
    let mut errors = vec![0.0; region.area() as usize];
    let mut error = ErrorEstimate::default();
    let mut counts = RayCounts::default();
    // Where nothing shines, nothing is followed.
    let least = FAINT * tolerance / tracer.brightest();
    for piece in region.blocks(PIECE) {
        let corners = Corners::new(tracer, piece, least);
        counts += corners.counts;
        let done: Vec<(Region, (Vec<Pixel>, RayCounts))> = piece
            .blocks(BLOCK)
            .into_par_iter()
            .map(|b| {
                let render = |scratch: &mut _| block::render(tracer, &corners, b, (tolerance, every_pixel), scratch);
                (b, WaveScratch::with(render))
            })
            .collect();
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
