//! Adaptive sampling of a region.
//!
//! Every pixel begins with a few points of its own sequence. The variance among them, pooled with that of
//! the pixels around, says how far its mean may be off and how many points it is worth; those that are
//! worth more get twice as many, and again, as long as that takes off enough (see [`super::pixel`]). The
//! differences between the halves tell how fast the error falls there. All that a block's pixels want is
//! traced together, so that packets are full.
//!
//! A pixel is a function of itself and of the first points of the pixels around it: the same for any region.

use std::cell::Cell;

use glam::DVec3;
use rayon::prelude::*;

use super::audit::{self, Audited};
use super::composite::Composite;
use super::coverage::{self, Shapes};
use super::pixel::{Pixel, Rule};
use super::points::{Sequence, centre, with_apron};
use super::proof::{Doubt, prove};
use crate::beam::lens::EDGE;
use crate::film::{ErrorEstimate, PlanePoint, Region, Tile};
use crate::integrate::{RayCounts, Sample, Tracer, WaveScratch, packets};
use crate::settings::{AuditRate, Tolerance};

/// Pixels along the edge of the pieces of a region that are worked on at a time.
const PIECE: u32 = 256;
/// Pixels along the edge of the blocks that threads take.
const BLOCK: u32 = 32;

/// The samples that pixels are made of; other sets have nothing in common with it.
pub(super) const PICTURE: u64 = 0;

/// Renders `region` within `tolerance`, and audits some of it.
pub(crate) fn render(tracer: &Tracer, region: Region, tolerance: Tolerance, rate: AuditRate) -> (Tile, RayCounts) {
    let mut pixels = vec![[0.0; 3]; region.area() as usize];
    let mut error = ErrorEstimate::default();
    let mut counts = RayCounts::default();
    let rule = Rule::new(tolerance);
    for piece in region.blocks(PIECE) {
        let first = first(tracer, with_apron(piece, &tracer.settings().view), tolerance, &rule, &mut counts);
        let blocks: Vec<_> = piece
            .blocks(BLOCK)
            .into_par_iter()
            .map(|block| {
                WaveScratch::with(|scratch| {
                    let mut counts = RayCounts::default();
                    let (pixels, composites) = Buffers::with(|buffers| {
                        Refinement { tracer, scratch, counts: &mut counts }.refine(block, &rule, &first, buffers)
                    });
                    let mut done: Vec<Audited> = block_pixels(block)
                        .zip(&pixels)
                        .map(|(at, p)| Audited {
                            at,
                            value: p.mean(),
                            points: p.points,
                            expected: p.error(),
                            open: !p.is_known(),
                            parts: None,
                        })
                        .collect();
                    for c in &composites {
                        let at = ((c.at.1 - block.y0) * block.width() + c.at.0 - block.x0) as usize;
                        let pixel = Audited { value: c.mean(), expected: c.error(), parts: Some(c), ..done[at] };
                        done[at] = pixel;
                    }
                    let mut error = ErrorEstimate::default();
                    done.iter().for_each(|p| error.add(p.expected));
                    audit::audit(tracer, &done, tolerance, rate, scratch, &mut counts, &mut error);
                    (block, done.iter().map(|p| p.value).collect::<Vec<_>>(), error, counts)
                })
            })
            .collect();
        for (block, part, e, c) in blocks {
            error += e;
            counts += c;
            for ((x, y), p) in block_pixels(block).zip(&part) {
                let at = (y - region.y0) as usize * region.width() as usize + (x - region.x0) as usize;
                pixels[at] = p.to_array().map(|c| c as f32);
            }
        }
    }
    (Tile { region, pixels, error }, counts)
}

/// Points to be traced and what they show: memory of a thread, since it would cost as much to be had as to be used.
#[derive(Default)]
pub(super) struct Buffers {
    pub(super) points: Vec<PlanePoint>,
    pub(super) samples: Vec<Sample>,
}

thread_local! {
    static BUFFERS: Cell<Buffers> = const { Cell::new(Buffers { points: Vec::new(), samples: Vec::new() }) };
}

impl Buffers {
    /// Points for which memory is kept: 4 MiB.
    const KEPT: usize = 1 << 17;

    /// Does `work` with this thread's memory, empty at first.
    pub(super) fn with<T>(work: impl FnOnce(&mut Self) -> T) -> T {
        let mut buffers = BUFFERS.take();
        let done = work(&mut buffers);
        buffers.points.clear();
        buffers.samples.clear();
        if buffers.points.capacity().max(buffers.samples.capacity()) <= Self::KEPT {
            BUFFERS.set(buffers);
        }
        done
    }
}

/// The pixels of a region, row by row.
pub(super) fn block_pixels(region: Region) -> impl Iterator<Item = (u32, u32)> {
    (region.y0..region.y1).flat_map(move |y| (region.x0..region.x1).map(move |x| (x, y)))
}

/// Pixels after their first points.
struct First {
    region: Region,
    pixels: Vec<Pixel>,
    /// The variances of their samples; NaN of what is proven, or good enough: of it nothing is learnt about others.
    variances: Vec<f64>,
    /// Those of them that have parts.
    composites: Vec<Composite>,
}

impl First {
    fn index(&self, (x, y): (u32, u32)) -> usize {
        (y - self.region.y0) as usize * self.region.width() as usize + (x - self.region.x0) as usize
    }

    fn at(&self, at: (u32, u32)) -> &Pixel {
        &self.pixels[self.index(at)]
    }

    /// The variance of the samples in pixel (x, y) and around it. A line that is seen in one of them is known
    /// to pass the others.
    fn pooled(&self, (x, y): (u32, u32)) -> f64 {
        let Region { x0, y0, x1, y1 } = self.region;
        let (mut sum, mut weights) = (0.0, 0.0);
        let (from, to) = (x.max(x0 + 1) - 1, (x + 2).min(x1));
        for j in y.max(y0 + 1) - 1..(y + 2).min(y1) {
            let row = &self.variances[self.index((from, j))..][..(to - from) as usize];
            for (i, variance) in (from..to).zip(row) {
                if variance.is_nan() {
                    continue;
                }
                let weight = [4.0, 2.0, 1.0][(x.abs_diff(i) + y.abs_diff(j)) as usize];
                sum += weight * variance;
                weights += weight;
            }
        }
        sum / weights
    }
}

/// What is in doubt of the pixels of a block.
struct Doubts {
    /// Of the tiles that lie in it, by row and column.
    tiles: Vec<(Doubt, Shapes)>,
    across: u32,
    x0: u32,
    y0: u32,
}

impl Doubts {
    fn new(tracer: &Tracer, block: Region, tolerance: Tolerance, rule: &Rule) -> Self {
        let view = &tracer.settings().view;
        let (x0, y0) = (block.x0 / EDGE, block.y0 / EDGE);
        let (across, down) = (block.x1.div_ceil(EDGE) - x0, block.y1.div_ceil(EDGE) - y0);
        let tiles = (0..across * down)
            .map(|k| {
                let at = centre(view, (x0 + k % across) * EDGE, (y0 + k / across) * EDGE);
                prove(tracer, at, tolerance.fraction(), rule.candidates())
            })
            .collect();
        Self { tiles, across, x0, y0 }
    }

    fn at(&self, (x, y): (u32, u32)) -> f32 {
        let tile = &self.tiles[((y / EDGE - self.y0) * self.across + x / EDGE - self.x0) as usize];
        tile.0[(y % EDGE * EDGE + x % EDGE) as usize]
    }

    /// The pixels of `block` that have parts.
    fn composites(&self, tracer: &Tracer, block: Region) -> Vec<Composite> {
        let view = &tracer.settings().view;
        let mut composites = Vec::new();
        for (k, (doubt, shapes)) in self.tiles.iter().enumerate().filter(|(_, (_, shapes))| !shapes.is_empty()) {
            let (i, j) = (self.x0 + k as u32 % self.across, self.y0 + k as u32 / self.across);
            for index in (0..EDGE * EDGE).filter(|at| doubt[*at as usize] > 0.0) {
                let (x, y) = (i * EDGE + index % EDGE, j * EDGE + index / EDGE);
                if x < block.x0 || x >= block.x1 || y < block.y0 || y >= block.y1 {
                    continue;
                }
                let middle = centre(view, x, y);
                let parts = coverage::parts(shapes, index, (f64::from(middle.x), f64::from(middle.y)));
                if !parts.is_empty() {
                    let doubt = f64::from(doubt[index as usize]);
                    composites.push(Composite::new((x, y), PICTURE, parts, doubt));
                }
            }
        }
        composites
    }
}

/// `region` cut along the picture's squares of `edge` × `edge` pixels, so that tiles are whole.
fn aligned(region: Region, edge: u32) -> Vec<Region> {
    let ends = |from: u32, to: u32| {
        let starts = (from / edge..to.div_ceil(edge)).map(move |k| k * edge);
        starts.map(move |s| (s.max(from), (s + edge).min(to)))
    };
    ends(region.y0, region.y1)
        .flat_map(|(y0, y1)| ends(region.x0, region.x1).map(move |(x0, x1)| Region { x0, y0, x1, y1 }))
        .collect()
}

/// Samples the first points of all pixels of `region`.
fn first(tracer: &Tracer, region: Region, tolerance: Tolerance, rule: &Rule, counts: &mut RayCounts) -> First {
    let view = &tracer.settings().view;
    let done: Vec<_> = aligned(region, BLOCK)
        .into_par_iter()
        .map(|block| {
            let mut counts = RayCounts::default();
            let mut order = Vec::new();
            packets(block.width(), block.height(), |i, j| order.push((block.x0 + i, block.y0 + j)));
            let doubts = Doubts::new(tracer, block, tolerance, rule);
            let composites = doubts.composites(tracer, block);
            let mut pixels = vec![Pixel::default(); block.area() as usize];
            Buffers::with(|Buffers { points, samples }| {
                for &at in &order {
                    if doubts.at(at) == 0.0 {
                        points.push(centre(view, at.0, at.1));
                    } else {
                        let sequence = Sequence::new(view, at, PICTURE);
                        points.extend((0..rule.first(doubts.at(at).into())).map(|k| sequence.point(k)));
                    }
                }
                samples.resize(points.len(), Sample::BLANK);
                WaveScratch::with(|scratch| tracer.trace(points, 0.0, samples, scratch, &mut counts));
                let mut rest = &samples[..];
                let mut next = |n: usize| {
                    let (these, behind) = rest.split_at(n);
                    rest = behind;
                    these
                };
                for at in order {
                    let pixel = &mut pixels[((at.1 - block.y0) * block.width() + at.0 - block.x0) as usize];
                    if doubts.at(at) == 0.0 {
                        *pixel = Pixel::known(next(1)[0].radiance);
                        continue;
                    }
                    let doubt = f64::from(doubts.at(at));
                    let n = rule.first(doubt);
                    *pixel = Pixel::doubted(doubt);
                    pixel.add(n, next(n as usize).iter().map(|s| s.radiance));
                }
            });
            (block, pixels, composites, counts)
        })
        .collect();
    let mut composites = Vec::new();
    let mut pixels = vec![Pixel::default(); region.area() as usize];
    for (block, part, more, c) in done {
        *counts += c;
        composites.extend(more);
        for (y, row) in (block.y0..block.y1).zip(part.chunks_exact(block.width() as usize)) {
            let at = (y - region.y0) as usize * region.width() as usize + (block.x0 - region.x0) as usize;
            pixels[at..at + row.len()].copy_from_slice(row);
        }
    }
    let variances = pixels.iter().map(|p| if p.has_variance() { p.variance() } else { f64::NAN }).collect();
    First { region, pixels, variances, composites }
}

/// Samples a block's pixels further.
struct Refinement<'a> {
    tracer: &'a Tracer,
    scratch: &'a mut WaveScratch,
    counts: &'a mut RayCounts,
}

impl Refinement<'_> {
    fn refine(
        &mut self,
        block: Region,
        rule: &Rule,
        first: &First,
        buffers: &mut Buffers,
    ) -> (Vec<Pixel>, Vec<Composite>) {
        let view = &self.tracer.settings().view;
        let mut pixels: Vec<Pixel> = block_pixels(block)
            .map(|at| {
                let mut pixel = *first.at(at);
                if pixel.has_variance() {
                    pixel.expect(first.pooled(at));
                } else if !pixel.is_known() {
                    pixel.expect_hidden();
                }
                pixel
            })
            .collect();
        let inside = |(x, y): (u32, u32)| (block.x0..block.x1).contains(&x) && (block.y0..block.y1).contains(&y);
        let mut composites: Vec<Composite> = first.composites.iter().filter(|c| inside(c.at)).cloned().collect();
        composites.iter_mut().filter(|c| first.at(c.at).has_variance()).for_each(|c| c.among(first.pooled(c.at)));
        let mut apart = vec![false; pixels.len()];
        composites
            .iter()
            .for_each(|c| apart[((c.at.1 - block.y0) * block.width() + c.at.0 - block.x0) as usize] = true);
        let mut active = Vec::new();
        packets(block.width(), block.height(), |i, j| {
            let at = j * block.width() + i;
            if !apart[at as usize] {
                active.push(at);
            }
        });
        let mut open: Vec<usize> = (0..composites.len()).collect();
        let Buffers { points, samples } = buffers;
        loop {
            let mut wanted = Vec::new();
            points.clear();
            for &at in &active {
                let pixel = &pixels[at as usize];
                let doublings = pixel.doublings(rule, 1.0);
                if doublings > 0 {
                    wanted.push((at, doublings));
                    let (i, j) = (at % block.width(), at / block.width());
                    let sequence = Sequence::new(view, (block.x0 + i, block.y0 + j), PICTURE);
                    points.extend((pixel.next..pixel.next << doublings).map(|k| sequence.point(k)));
                }
            }
            let mut parts = Vec::new();
            for &at in &open {
                let more = composites[at].wanted(rule);
                if more.iter().any(|n| *n > 0) {
                    composites[at].ask(view, &more, points);
                    parts.push((at, more));
                }
            }
            if points.is_empty() {
                return (pixels, composites);
            }
            samples.resize(points.len(), Sample::BLANK);
            self.tracer.trace(points, 0.0, samples, self.scratch, self.counts);
            let mut next = 0;
            for &(at, doublings) in &wanted {
                let pixel = &mut pixels[at as usize];
                for _ in 0..doublings {
                    let n = pixel.next as usize;
                    pixel.add(n as u32, samples[next..next + n].iter().map(|s| s.radiance));
                    next += n;
                }
            }
            for (at, more) in &parts {
                let n = more.iter().sum::<u32>() as usize;
                composites[*at].take(view, more, &samples[next..next + n]);
                next += n;
            }
            active.clear();
            active.extend(wanted.iter().map(|(at, _)| *at));
            open.clear();
            open.extend(parts.iter().map(|(at, _)| *at));
        }
    }
}

/// The mean of samples.
pub(super) fn mean(samples: &[Sample]) -> DVec3 {
    samples.iter().map(|s| s.radiance).sum::<DVec3>() * (1.0 / samples.len().max(1) as f64)
}
