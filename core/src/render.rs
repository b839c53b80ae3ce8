//! Tiles: the points of a sampling traced, and their means taken. Above both `integrate`, which knows nothing
//! of pixels, and [`sampling`](crate::sampling), which chooses the points.

use glam::DVec3;
use rayon::prelude::*;

use crate::film::{ErrorEstimate, PlanePoint, Region, Tile};
use crate::integrate::{RayCounts, Sample, Tracer, WaveScratch, packets};
use crate::sampling::points::Sequence;
use crate::sampling::{adaptive, coarse};
use crate::settings::{AuditRate, Detail, Pass, Sampling};

/// Pixels along the edge of the blocks that threads take: large ones keep more of the rays that
/// mirrors send on side by side, small ones keep more threads busy.
const BLOCK: [u32; 2] = [32, 16];

impl Tracer {
    /// Renders the pixels of `region` by uniform sampling, in parallel on the calling rayon pool; of an adaptive
    /// picture, the coarsest there is ([`Tracer::render_pass`] gives others).
    ///
    /// # Panics
    /// When `region` reaches outside the picture.
    #[must_use]
    pub fn render(&self, region: Region) -> (Tile, RayCounts) {
        let view = &self.settings().view;
        assert!(region.x1 <= view.width() && region.y1 <= view.height(), "region outside the picture");
        if self.settings().sampling == Sampling::Adaptive {
            return coarse::render(self, region, Detail::COARSEST, AuditRate::default());
        }
        let threads = rayon::current_num_threads();
        let [large, small] = BLOCK;
        let few = region.area() < 4 * threads as u64 * u64::from(large * large);
        let blocks = region.blocks(if few && threads > 1 { small } else { large });
        let mut pixels = vec![[0.0; 3]; region.area() as usize];
        let mut counts = RayCounts::default();
        let width = region.width() as usize;
        let start = |block: &Region| (block.y0 - region.y0) as usize * width + (block.x0 - region.x0) as usize;
        if threads == 1 {
            let mut scratch = BlockScratch::default();
            for block in blocks {
                self.block(block, &mut scratch, &mut counts, &mut pixels[start(&block)..], width);
            }
            return (Tile { region, pixels, error: ErrorEstimate::default() }, counts);
        }
        let done: Vec<(Region, Vec<[f32; 3]>, RayCounts)> = blocks
            .into_par_iter()
            .map_init(BlockScratch::default, |scratch, block| {
                let mut counts = RayCounts::default();
                let mut pixels = vec![[0.0; 3]; block.area() as usize];
                self.block(block, scratch, &mut counts, &mut pixels, block.width() as usize);
                (block, pixels, counts)
            })
            .collect();
        for (block, part, c) in done {
            counts += c;
            let lines = pixels[start(&block)..].chunks_mut(width);
            for (to, line) in lines.zip(part.chunks_exact(block.width() as usize)) {
                to[..line.len()].copy_from_slice(line);
            }
        }
        (Tile { region, pixels, error: ErrorEstimate::default() }, counts)
    }

    /// Renders the pixels of `region` in one pass of an adaptive picture, and audits some of them, in parallel on
    /// the calling rayon pool. Under uniform sampling the result is that of [`Tracer::render`].
    ///
    /// # Panics
    /// When `region` reaches outside the picture.
    #[must_use]
    pub fn render_pass(&self, region: Region, pass: Pass) -> (Tile, RayCounts) {
        let view = &self.settings().view;
        assert!(region.x1 <= view.width() && region.y1 <= view.height(), "region outside the picture");
        match (self.settings().sampling, pass.detail) {
            (Sampling::Adaptive, Detail::Coarse { step }) => coarse::render(self, region, step, pass.audit),
            (Sampling::Adaptive, Detail::Within(t)) => adaptive::render(self, region, t, pass.audit, false),
            (Sampling::Adaptive, Detail::Glance(t)) => adaptive::render(self, region, t, pass.audit, true),
            _ => self.render(region),
        }
    }

    /// Renders `block` to the front of `pixels`, `stride` pixels a row.
    fn block(
        &self,
        block: Region,
        scratch: &mut BlockScratch,
        counts: &mut RayCounts,
        pixels: &mut [[f32; 3]],
        stride: usize,
    ) {
        if let Sampling::Scrambled { samples } = self.settings().sampling {
            return self.scrambled_block(block, samples, scratch, counts, pixels, stride);
        }
        let n = self.grid();
        let (width, height) = (block.width() * n, block.height() * n);
        let BlockScratch { points, samples, ordered } = scratch;
        points.clear();
        packets(width, height, |x, y| points.push(self.frame().cell(block.x0 * n + x, block.y0 * n + y)));
        samples.resize(points.len(), Sample::BLANK);
        WaveScratch::with(|wave| self.trace(points, 0.0, samples, wave, counts));
        let single = |v: DVec3| [v.x as f32, v.y as f32, v.z as f32];
        let mut done = samples.iter();
        if n == 1 {
            packets(width, height, |x, y| {
                if let Some(sample) = done.next() {
                    pixels[y as usize * stride + x as usize] = single(sample.radiance);
                }
            });
            return;
        }
        ordered.resize(points.len(), DVec3::ZERO);
        packets(width, height, |x, y| {
            if let Some(sample) = done.next() {
                ordered[(y * width + x) as usize] = sample.radiance;
            }
        });
        let share = 1.0 / f64::from(n * n);
        for j in 0..block.height() {
            for i in 0..block.width() {
                let mut sum = DVec3::ZERO;
                for b in 0..n {
                    let row = ((j * n + b) * width + i * n) as usize;
                    sum = ordered[row..row + n as usize].iter().fold(sum, |sum, &x| sum + x);
                }
                pixels[j as usize * stride + i as usize] = single(sum * share);
            }
        }
    }
    /// The same by so many points of each pixel's sequence.
    fn scrambled_block(
        &self,
        block: Region,
        n: u32,
        scratch: &mut BlockScratch,
        counts: &mut RayCounts,
        pixels: &mut [[f32; 3]],
        stride: usize,
    ) {
        let view = &self.settings().view;
        let BlockScratch { points, samples, .. } = scratch;
        // As many points at a time as keep packets full and memory small.
        let rows = (4096 / (block.width() * n).max(1)).clamp(1, 8) * 4;
        for strip in block.blocks(block.width().max(rows)).into_iter().flat_map(|b| strips(b, rows)) {
            points.clear();
            packets(strip.width(), strip.height(), |i, j| {
                let sequence = Sequence::new(view, (strip.x0 + i, strip.y0 + j), 0);
                points.extend((0..n).map(|k| sequence.point(k)));
            });
            samples.resize(points.len(), Sample::BLANK);
            WaveScratch::with(|wave| self.trace(points, 0.0, samples, wave, counts));
            let mut done = samples.chunks_exact(n as usize);
            packets(strip.width(), strip.height(), |i, j| {
                if let Some(of_pixel) = done.next() {
                    let sum: DVec3 = of_pixel.iter().map(|s| s.radiance).sum();
                    let at = (strip.y0 - block.y0 + j) as usize * stride + (strip.x0 - block.x0 + i) as usize;
                    pixels[at] = (sum * (1.0 / f64::from(n))).to_array().map(|c| c as f32);
                }
            });
        }
    }
}

/// `region` cut into strips of so many rows.
fn strips(region: Region, rows: u32) -> impl Iterator<Item = Region> {
    (region.y0..region.y1).step_by(rows as usize).map(move |y0| Region { y0, y1: region.y1.min(y0 + rows), ..region })
}

/// Memory of a thread that renders blocks.
#[derive(Default)]
struct BlockScratch {
    points: Vec<PlanePoint>,
    samples: Vec<Sample>,
    ordered: Vec<DVec3>,
}
