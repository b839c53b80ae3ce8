//! How far the means of pixels are off that a straight edge passes, by scrambled points: what the sampler's model of
//! errors is fitted to.

use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, dvec3};
use rayon::prelude::*;
use tessera_core::film::Region;
use tessera_core::settings::{Sampling, Settings};
use tessera_core::trace::{PreparedScene, Tracer};

use crate::generate::{Document, Look, Random};
use crate::subject::settings;
use crate::truth::whole;

/// Pixels along the picture's edge, and along that of the blocks that are rendered of it.
const PIXELS: u32 = 256;
const BLOCK: u32 = 16;

/// What pixels on edges came to, sums over all of them; white on one side and black on the other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Pixels.
    pub pixels: f64,
    /// Variances over the pixel's area.
    pub variance: f64,
    /// Squared errors of the means.
    pub squares: f64,
}

/// Renders one edge for each seed, at a place and an angle that any line is as likely to have, by each number of
/// points; gives what the pixels that it passes came to, an edge and in it a number of points after the other.
///
/// # Panics
/// Never: scenes and settings are in range.
#[must_use]
pub fn measure(seeds: Range<u64>, points: &[u32]) -> Vec<Vec<Seen>> {
    seeds.into_par_iter().map(|seed| Edge::new(&mut Random::new(seed)).measure(points)).collect()
}

/// κ of a pixel of variance 1, by what all edges came to at so many points.
#[must_use]
pub fn kappa(seen: &[Seen], points: u32) -> f64 {
    let (squares, variance) = seen.iter().fold((0.0, 0.0), |(s, v), e| (s + e.squares, v + e.variance));
    let n = f64::from(points);
    squares / variance * n * n.sqrt()
}

/// The straight line a·x + b·y = c over the picture, from (0, 0) to (1, 1), y down; white where less.
struct Edge {
    a: f64,
    b: f64,
    c: f64,
}

impl Edge {
    fn new(random: &mut Random) -> Self {
        let angle = random.between(0.0, TAU);
        let (a, b) = (libm::cos(angle), libm::sin(angle));
        // All that cross the circle in the picture.
        Self { a, b, c: 0.5 * (a + b) + random.between(-0.5, 0.5) }
    }

    /// The share of a square that is white.
    fn white(&self, (x, y): (f64, f64), edge: f64) -> f64 {
        let corners = [(x, y), (x + edge, y), (x + edge, y + edge), (x, y + edge)];
        let side = |(x, y): (f64, f64)| self.a * x + self.b * y - self.c;
        let mut inside = Vec::with_capacity(5);
        for k in 0..4 {
            let (p, q) = (corners[k], corners[(k + 1) % 4]);
            let (s, t) = (side(p), side(q));
            if s < 0.0 {
                inside.push(p);
            }
            if (s < 0.0) != (t < 0.0) {
                let u = s / (s - t);
                inside.push((p.0 + u * (q.0 - p.0), p.1 + u * (q.1 - p.1)));
            }
        }
        let next = inside.iter().cycle().skip(1);
        // Corners from one of their own, so that little is taken from much.
        let twice: f64 = inside.iter().zip(next).map(|(p, q)| (p.0 - x) * (q.1 - y) - (q.0 - x) * (p.1 - y)).sum();
        (0.5 * twice / (edge * edge)).clamp(0.0, 1.0)
    }

    /// A black triangle before a white sky that has this edge, and no other one in the picture.
    fn document(&self) -> Document {
        let at = |x: f64, y: f64| dvec3(x - 0.5, 0.5 - y, 1.0);
        // The line's point next to the middle.
        let off = self.c - 0.5 * (self.a + self.b);
        let (x, y) = (0.5 + off * self.a, 0.5 + off * self.b);
        let far = 30.0;
        let corners = [
            at(x - far * self.b, y + far * self.a),
            at(x + far * self.b, y - far * self.a),
            at(x + far * self.a, y + far * self.b),
        ];
        let black = Look::matte(0.0, 0.0, 0.0);
        Document::new(DVec3::ZERO, DVec3::Z).with_background(1.0, 1.0, 1.0).triangle(corners, black)
    }

    fn measure(&self, points: &[u32]) -> Vec<Seen> {
        let scene = self.document().scene().unwrap_or_else(|e| unreachable!("{e}"));
        let scene = Arc::new(PreparedScene::build(Arc::new(scene)));
        let plain = settings(PIXELS, PIXELS);
        let pixel = 1.0 / f64::from(PIXELS);
        let share = |x: u32, y: u32, edge: u32| {
            self.white((f64::from(x) * pixel, f64::from(y) * pixel), f64::from(edge) * pixel)
        };
        let mut blocks = whole(&plain).blocks(BLOCK);
        blocks.retain(|r| {
            let white = share(r.x0, r.y0, BLOCK);
            white > 0.0 && white < 1.0
        });
        let mut all = Vec::with_capacity(points.len());
        for &samples in points {
            let settings = Settings { sampling: Sampling::Scrambled { samples }, ..plain };
            let tracer = Tracer::new(Arc::clone(&scene), settings).unwrap_or_else(|e| unreachable!("{e}"));
            let mut seen = Seen::default();
            for block in &blocks {
                add(&tracer, *block, share, &mut seen);
            }
            all.push(seen);
        }
        all
    }
}

/// Renders a block and adds those of its pixels that the edge passes, by the share of each that is white.
fn add(tracer: &Tracer, block: Region, share: impl Fn(u32, u32, u32) -> f64, seen: &mut Seen) {
    let (tile, _) = tracer.render(block);
    for (k, pixel) in tile.pixels.iter().enumerate() {
        let (x, y) = (block.x0 + k as u32 % BLOCK, block.y0 + k as u32 / BLOCK);
        let white = share(x, y, 1);
        if white > 0.0 && white < 1.0 {
            let error = f64::from(pixel[0]) - white;
            seen.pixels += 1.0;
            seen.variance += white * (1.0 - white);
            seen.squares += error * error;
        }
    }
}
