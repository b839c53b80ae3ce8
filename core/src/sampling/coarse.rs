//! A coarse picture: one point in every square of several pixels.

use glam::DVec3;

use super::adaptive::block_pixels;
use super::audit::{Audit, Audited};
use super::points::{Sequence, hash};
use crate::film::{ErrorEstimate, Region, Tile};
use crate::integrate::{RayCounts, Sample, Tracer, WaveScratch};
use crate::settings::{AuditRate, Tolerance};

/// Draws the pixel of a square that is sampled.
const PICK: u64 = 4;

/// Renders `region` by one point in every square of `step` × `step` pixels of the picture.
pub(crate) fn render(tracer: &Tracer, region: Region, step: u32, rate: AuditRate) -> (Tile, RayCounts) {
    let view = &tracer.settings().view;
    let squares = Region {
        x0: region.x0 / step,
        y0: region.y0 / step,
        x1: region.x1.div_ceil(step),
        y1: region.y1.div_ceil(step),
    };
    let points: Vec<_> = block_pixels(squares)
        .map(|(i, j)| {
            let pick = hash(i, j, PICK);
            // Squares at the picture's ends are cut off.
            let at = |square: u32, size: u32, pick: u64| {
                let wide = step.min(size - square * step);
                square * step + (((pick & 0xffff_ffff) * u64::from(wide)) >> 32) as u32
            };
            let pixel = (at(i, view.width(), pick), at(j, view.height(), pick >> 32));
            Sequence::new(view, pixel, super::adaptive::PICTURE).point(0)
        })
        .collect();
    let mut counts = RayCounts::default();
    let mut samples = vec![Sample::BLANK; points.len()];
    let mut error = ErrorEstimate::default();
    let value = |samples: &[Sample], (x, y): (u32, u32)| {
        let (i, j) = (x / step - squares.x0, y / step - squares.y0);
        samples[(j * squares.width() + i) as usize].radiance
    };
    WaveScratch::with(|scratch| {
        tracer.trace(&points, 0.0, &mut samples, scratch, &mut counts);
        block_pixels(region).for_each(|_| error.add(0.0));
        let audit = Audit { tracer, tolerance: Tolerance::MAX, rate };
        let drawn: Vec<Audited> = block_pixels(region)
            .filter_map(|at| {
                let probability = audit.draws(at, 0.0, true)?;
                Some(Audited { at, value: value(&samples, at), points: 1, probability, parts: None })
            })
            .collect();
        audit.check(&drawn, scratch, &mut counts, &mut error);
    });
    let single = |v: DVec3| v.to_array().map(|c| c as f32);
    let pixels = block_pixels(region).map(|at| single(value(&samples, at))).collect();
    (Tile { region, pixels, error }, counts)
}
