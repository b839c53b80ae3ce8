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

use super::audit::{Audit, Audited};
use super::composite::Composite;
use super::coverage::{self, Shapes};
use super::pixel::{Pixel, Rule};
use super::points::{Sequence, centre, with_apron};
use super::proof::{Doubt, prove};
use crate::beam::lens::EDGE;
use crate::film::{ErrorEstimate, PlanePoint, Region, Tile};
use crate::integrate::{RayCounts, Sample, Tracer, WaveScratch, packets};
use crate::settings::{AuditRate, Tolerance};
use crate::simd::LANES;

/// Pixels along the edge of the pieces of a region that are worked on at a time.
const PIECE: u32 = 256;
/// Pixels along the edge of the blocks that threads take.
const BLOCK: u32 = 32;

/// The square by which means of two pixels are apart is explained by so many times their variances. Chosen: one of four
/// points that is on the other side of an edge explains it.
const INSIDE: f64 = 4.0;

/// The samples that pixels are made of; other sets have nothing in common with it.
pub(super) const PICTURE: u64 = 0;

/// Renders `region` within `tolerance`, and audits some of it; with each of the picture's squares of [`EDGE`] × [`EDGE`]
/// pixels known by itself where they are `alone`.
pub(crate) fn render(
    tracer: &Tracer,
    region: Region,
    tolerance: Tolerance,
    rate: AuditRate,
    alone: bool,
) -> (Tile, RayCounts) {
    let mut pixels = vec![[0.0; 3]; region.area() as usize];
    let mut error = ErrorEstimate::default();
    let mut counts = RayCounts::default();
    let rule = Rule::new(tolerance);
    let audit = Audit { tracer, tolerance, rate };
    let (pieces, squares) = if alone { (aligned(region, EDGE), EDGE) } else { (region.blocks(PIECE), u32::MAX) };
    for piece in pieces {
        let (blocks, around) = begin_all(tracer, piece, squares, tolerance, &rule, &mut counts);
        let done: Vec<_> = blocks
            .into_par_iter()
            .map(|mut block| {
                WaveScratch::with(|scratch| {
                    let (mut error, mut counts) = (ErrorEstimate::default(), RayCounts::default());
                    block.expect(&around);
                    block.refine(tracer, &rule, scratch, &mut counts);
                    let (values, drawn) = block.finish(&audit, &mut error);
                    audit.check(&drawn, scratch, &mut counts, &mut error);
                    (block.region, values, error, counts)
                })
            })
            .collect();
        for (block, values, e, c) in done {
            error += e;
            counts += c;
            for (y, row) in (block.y0..block.y1).zip(values.chunks_exact(block.width() as usize)) {
                let at = (y - region.y0) as usize * region.width() as usize + (block.x0 - region.x0) as usize;
                pixels[at..at + row.len()].copy_from_slice(row);
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

/// What the first samples of a piece's pixels tell of others, and those of the pixels around it.
struct Surroundings {
    piece: Region,
    /// Row by row, with one more pixel on each side; NaN of what is proven, good enough, or of no use: of its variance
    /// nothing is learnt about others.
    variances: Vec<f64>,
    /// Means in the same order; NaN of what was not sampled.
    means: Vec<DVec3>,
}

impl Surroundings {
    fn new(piece: Region) -> Self {
        let size = (piece.width() as usize + 2) * (piece.height() as usize + 2);
        Self { piece, variances: vec![f64::NAN; size], means: vec![DVec3::NAN; size] }
    }

    fn stride(&self) -> usize {
        self.piece.width() as usize + 2
    }

    /// Where pixel (x, y) is in them, one outside the piece at most.
    fn index(&self, (x, y): (u32, u32)) -> usize {
        (y + 1 - self.piece.y0) as usize * self.stride() + (x + 1 - self.piece.x0) as usize
    }

    fn note(&mut self, block: &Block) {
        let (region, width) = (block.region, block.region.width() as usize);
        for (y, row) in (region.y0..).zip(block.pixels.chunks_exact(width)) {
            let at = self.index((region.x0, y));
            let to = self.variances[at..at + width].iter_mut().zip(&mut self.means[at..at + width]);
            for ((value, mean), pixel) in to.zip(row) {
                *mean = pixel.mean();
                if pixel.has_variance() {
                    *value = pixel.variance();
                }
            }
        }
    }

    /// Whether any pixel of the piece is to learn from `region`, which lies around it.
    fn are_wanted(&self, region: &Region) -> bool {
        let Region { x0, y0, x1, y1 } = self.piece;
        let near = Region {
            x0: region.x0.saturating_sub(1).max(x0),
            y0: region.y0.saturating_sub(1).max(y0),
            x1: (region.x1 + 1).min(x1),
            y1: (region.y1 + 1).min(y1),
        };
        block_pixels(near).any(|at| !self.variances[self.index(at)].is_nan())
    }

    /// The variance of the samples in and around a pixel of the piece. A line that is seen in one pixel is known to
    /// pass the others.
    fn pooled(&self, at: (u32, u32)) -> f64 {
        let first = self.index(at) - self.stride() - 1;
        let (mut sum, mut weights) = (0.0, 0.0);
        for (j, of) in [[1.0, 2.0, 1.0], [2.0, 4.0, 2.0], [1.0, 2.0, 1.0]].into_iter().enumerate() {
            for (variance, weight) in self.variances[first + j * self.stride()..][..3].iter().zip(of) {
                let is_known = !variance.is_nan();
                sum += if is_known { weight * variance } else { 0.0 };
                weights += if is_known { weight } else { 0.0 };
            }
        }
        sum / weights
    }

    /// The square of the contrast with which an edge seems to lie between a pixel of the piece and one beside it: of
    /// how far their means are apart, where the samples of neither tell why. The components' mean.
    fn step(&self, at: (u32, u32)) -> f64 {
        let here = self.index(at);
        let beside = [here - self.stride(), here - 1, here + 1, here + self.stride()];
        let steps = beside.map(|there| {
            let variances = [here, there].map(|k| self.variances[k]).into_iter().filter(|v| !v.is_nan());
            let apart = (self.means[here] - self.means[there]).length_squared() / 3.0;
            apart - INSIDE * variances.sum::<f64>()
        });
        // Of what was not sampled nothing is known, and `max` leaves it out.
        steps.into_iter().fold(0.0, f64::max)
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

/// Samples the first points of all pixels of `piece`, by blocks, and of those around it from which they learn, as far as
/// these are in the same square of so many pixels.
fn begin_all(
    tracer: &Tracer,
    piece: Region,
    squares: u32,
    tolerance: Tolerance,
    rule: &Rule,
    counts: &mut RayCounts,
) -> (Vec<Block>, Surroundings) {
    let mut around = Surroundings::new(piece);
    let mut begin = |regions: Vec<Region>, around: &mut Surroundings| {
        let begun: Vec<_> = regions.into_par_iter().map(|r| Block::begin(tracer, r, tolerance, rule)).collect();
        let mut blocks = Vec::with_capacity(begun.len());
        for (block, c) in begun {
            *counts += c;
            around.note(&block);
            blocks.push(block);
        }
        blocks
    };
    let blocks = begin(aligned(piece, BLOCK), &mut around);
    let Region { x0, y0, x1, y1 } = with_apron(piece, squares, &tracer.settings().view);
    let sides = [
        Region { x0, y0, x1, y1: piece.y0 },
        Region { x0, y0: piece.y1, x1, y1 },
        Region { x0, y0: piece.y0, x1: piece.x0, y1: piece.y1 },
        Region { x0: piece.x1, y0: piece.y0, x1, y1: piece.y1 },
    ];
    let sides = sides.into_iter().filter(|side| side.x0 < side.x1 && side.y0 < side.y1);
    let wanted = sides.flat_map(|side| aligned(side, EDGE)).filter(|r| around.are_wanted(r)).collect();
    begin(wanted, &mut around);
    (blocks, around)
}

/// The pixels of a block while they are sampled further.
struct Block {
    region: Region,
    /// Row by row.
    pixels: Vec<Pixel>,
    /// What has parts, in the order of the pixels.
    composites: Vec<Composite>,
}

impl Block {
    /// With the first points of all pixels of `region`, which is part of a square of [`BLOCK`] pixels.
    fn begin(tracer: &Tracer, region: Region, tolerance: Tolerance, rule: &Rule) -> (Self, RayCounts) {
        let view = &tracer.settings().view;
        let mut counts = RayCounts::default();
        let doubts = Doubts::new(tracer, region, tolerance, rule);
        let composites = doubts.composites(tracer, region);
        let mut pixels = vec![Pixel::default(); region.area() as usize];
        Buffers::with(|Buffers { points, samples }| {
            // Where each pixel is in the block, how much is in doubt of it, and its first points.
            let mut order = Vec::with_capacity(pixels.len());
            packets(region.width(), region.height(), |i, j| {
                let at = (region.x0 + i, region.y0 + j);
                let doubt = f64::from(doubts.at(at));
                let n = if doubt == 0.0 { 1 } else { rule.first(doubt) };
                order.push((j * region.width() + i, doubt, n));
                if doubt == 0.0 {
                    points.push(centre(view, at.0, at.1));
                } else {
                    let sequence = Sequence::new(view, at, PICTURE);
                    points.extend((0..n).map(|k| sequence.point(k)));
                }
            });
            samples.resize(points.len(), Sample::BLANK);
            WaveScratch::with(|scratch| tracer.trace(points, 0.0, samples, scratch, &mut counts));
            let mut rest = &samples[..];
            for (at, doubt, n) in order {
                let (these, behind) = rest.split_at(n as usize);
                rest = behind;
                let pixel = &mut pixels[at as usize];
                if doubt == 0.0 {
                    *pixel = Pixel::known(these[0].radiance);
                } else {
                    *pixel = Pixel::doubted(doubt);
                    pixel.add(n, these.iter().map(|s| s.radiance));
                }
            }
        });
        (Self { region, pixels, composites }, counts)
    }

    /// Notes what is expected of each pixel after the first points, those around it taken into account.
    fn expect(&mut self, around: &Surroundings) {
        let region = self.region;
        for (pixel, at) in self.pixels.iter_mut().zip(block_pixels(region)) {
            if pixel.has_variance() {
                pixel.expect(around.pooled(at), around.step(at));
            } else if !pixel.is_known() {
                pixel.expect_hidden();
            }
        }
        let index = |c: &Composite| ((c.at.1 - region.y0) * region.width() + c.at.0 - region.x0) as usize;
        self.composites.sort_unstable_by_key(index);
        for composite in &mut self.composites {
            if self.pixels[index(composite)].has_variance() {
                composite.among(around.pooled(composite.at));
            }
        }
    }

    /// Where its `k`-th pixel is in the picture.
    fn place(&self, k: u32) -> (u32, u32) {
        (self.region.x0 + k % self.region.width(), self.region.y0 + k / self.region.width())
    }

    /// Pixels of one part that may want points, as packets have them.
    fn open(&self) -> Vec<u32> {
        let mut open = Vec::with_capacity(self.pixels.len());
        packets(self.region.width(), self.region.height(), |i, j| {
            let k = j * self.region.width() + i;
            let order = |c: &Composite| (c.at.1, c.at.0).cmp(&(self.region.y0 + j, self.region.x0 + i));
            if !self.pixels[k as usize].is_known() && self.composites.binary_search_by(order).is_err() {
                open.push(k);
            }
        });
        open
    }

    /// Samples pixels and parts until none is worth more points.
    fn refine(&mut self, tracer: &Tracer, rule: &Rule, scratch: &mut WaveScratch, counts: &mut RayCounts) {
        let view = &tracer.settings().view;
        let mut pixels = self.open();
        let mut composites: Vec<usize> = (0..self.composites.len()).collect();
        Buffers::with(|Buffers { points, samples }| {
            loop {
                points.clear();
                let (mut wanted, mut places) = (Vec::new(), Vec::new());
                for k in pixels.drain(..) {
                    let pixel = &self.pixels[k as usize];
                    let doublings = pixel.doublings(rule, 1.0);
                    if doublings > 0 {
                        wanted.push((k, doublings));
                        let sequence = Sequence::new(view, self.place(k), PICTURE);
                        Runs::new(pixel.next, doublings).ask(&sequence, points, &mut places);
                    }
                }
                let mut parts = Vec::new();
                for k in composites.drain(..) {
                    let more = self.composites[k].wanted(rule);
                    if more.iter().any(|n| *n > 0) {
                        self.composites[k].ask(view, &more, points);
                        parts.push((k, more));
                    }
                }
                if points.is_empty() {
                    return;
                }
                samples.resize(points.len(), Sample::BLANK);
                tracer.trace(points, 0.0, samples, scratch, counts);
                let mut rest = &samples[..];
                let mut next = |n: usize| {
                    let (these, behind) = rest.split_at(n);
                    rest = behind;
                    these
                };
                let mut places = places.iter();
                for (k, doublings) in wanted {
                    let pixel = &mut self.pixels[k as usize];
                    let these = next(Runs::new(pixel.next, doublings).count as usize);
                    for _ in 0..doublings {
                        let half = places.by_ref().take(pixel.next as usize);
                        pixel.add(pixel.next, half.map(|place| these[*place as usize].radiance));
                    }
                    pixels.push(k);
                }
                for (k, more) in parts {
                    self.composites[k].take(view, &more, next(more.iter().sum::<u32>() as usize));
                    composites.push(k);
                }
            }
        });
    }

    /// The pixels' values, and which of them are drawn to be audited; what they are expected to err by goes to `error`.
    fn finish(&self, audit: &Audit<'_>, error: &mut ErrorEstimate) -> (Vec<[f32; 3]>, Vec<Audited<'_>>) {
        let mut values = Vec::with_capacity(self.pixels.len());
        let mut drawn = Vec::new();
        let mut composites = self.composites.iter().peekable();
        for (pixel, at) in self.pixels.iter().zip(block_pixels(self.region)) {
            let parts = composites.next_if(|c| c.at == at);
            let (value, expected) = parts.map_or_else(|| (pixel.mean(), pixel.error()), |c| (c.mean(), c.error()));
            error.add(expected);
            if let Some(probability) = audit.draws(at, expected, !pixel.is_known()) {
                drawn.push(Audited { at, value, points: pixel.points, probability, parts });
            }
            values.push(value.to_array().map(|c| c as f32));
        }
        (values, drawn)
    }
}

/// A pixel's next points in the order in which they are traced: by the squares of the pixel that they lie in, where
/// those of a square fill packets, which then are as narrow as a finer grid's.
#[derive(Clone, Copy, Debug)]
struct Runs {
    /// The first number.
    from: u32,
    count: u32,
    /// Squares along the pixel's edge are two to the power of this.
    level: u32,
}

impl Runs {
    /// Of a pixel that has `from` points, to be doubled so often.
    fn new(from: u32, doublings: u32) -> Self {
        let count = (from << doublings) - from;
        let mut level = 0;
        while from.is_multiple_of(4 << (2 * level)) && count.is_multiple_of((4 * LANES as u32) << (2 * level)) {
            level += 1;
        }
        Self { from, count, level }
    }

    /// Adds the points to `points`; and to `places`, by their numbers, which of them they are.
    fn ask(self, sequence: &Sequence, points: &mut Vec<PlanePoint>, places: &mut Vec<u32>) {
        let Self { from, count, level } = self;
        if level == 0 {
            points.extend((from..from + count).map(|number| sequence.point(number)));
            places.extend(0..count);
            return;
        }
        let start = points.len();
        points.resize(start + count as usize, PlanePoint { x: 0, y: 0 });
        // Of as many points in a row as there are squares, one lies in each.
        let of_square = count >> (2 * level);
        for k in 0..count {
            let point = sequence.point(from + k);
            let place = sequence.square(point, level) * of_square + (k >> (2 * level));
            points[start + place as usize] = point;
            places.push(place);
        }
    }
}

/// The mean of samples.
pub(super) fn mean(samples: &[Sample]) -> DVec3 {
    samples.iter().map(|s| s.radiance).sum::<DVec3>() * (1.0 / samples.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::UNIT;
    use crate::settings::View;

    #[test]
    fn a_pixels_next_points_are_all_asked_and_their_packets_are_narrow() {
        let view = View::new(8, 8, 1.0, 1.0).expect("a view");
        let (sequence, corner) = (Sequence::new(&view, (3, 5), PICTURE), centre(&view, 3, 5));
        let levels = [(2, 1, 0), (4, 2, 0), (16, 2, 0), (32, 1, 0), (64, 1, 1), (64, 2, 1), (256, 1, 2), (1024, 2, 3)];
        for (from, doublings, level) in levels {
            let runs = Runs::new(from, doublings);
            assert_eq!(runs.level, level, "{runs:?}");
            let (mut points, mut places) = (vec![corner], Vec::new());
            runs.ask(&sequence, &mut points, &mut places);
            assert_eq!(points.len() - 1, places.len());
            let numbers = from..from << doublings;
            assert!(
                numbers.zip(&places).all(|(n, place)| sequence.point(n) == points[1 + *place as usize]),
                "{runs:?}"
            );
            for packet in points[1..].chunks(LANES).filter(|_| level > 0) {
                let wide = |of: fn(&PlanePoint) -> i32| {
                    let all = packet.iter().map(of);
                    all.clone().max().zip(all.min()).map(|(most, least)| most - least)
                };
                assert!([wide(|p| p.x), wide(|p| p.y)].iter().all(|w| *w < Some(UNIT >> level)), "{runs:?}");
            }
        }
    }
}
