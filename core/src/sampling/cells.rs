//! A pixel cut into rectangles whose corners are looked at.
//!
//! A cell's mean is taken to be that of its corners, and how far they are apart tells how far that
//! may be off. Where it is worth it a cell is halved, so that points gather where edges are
//! (Whitted, *An improved illumination model for shaded display*, CACM 23(6), 1980). Corners serve
//! all cells that they touch, and often the neighbouring pixels.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::ops::Range;

use glam::{DVec2, DVec3};

use super::cuts::Error;
use super::lattice::UNIT;
use crate::trace::record::NONE;
use crate::trace::{PlanePoint, mix};

/// The shortest side of a cell, in lattice units.
const SHORTEST: u16 = UNIT as u16 / 1024;

/// The share of a cell's variance that its halves are taken to have at least: where everything differs, some
/// corners are alike by chance.
const INHERITED: f64 = 0.5;

/// Places of points by a number that stands for each.
pub(super) type Index<K> = HashMap<K, u32, BuildHasherDefault<Mixed>>;

/// A hasher for numbers.
#[derive(Default)]
pub(super) struct Mixed(u64);

impl Hasher for Mixed {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.write_u64(u64::from(b));
        }
    }

    fn write_u32(&mut self, x: u32) {
        self.write_u64(u64::from(x));
    }

    fn write_u64(&mut self, x: u64) {
        self.0 = mix(self.0, x);
    }
}

/// A point of a pixel, in lattice units from its upper left corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) x: u16,
    pub(super) y: u16,
    /// What it shows of what is looked at, and what it meets first.
    pub(super) open: DVec3,
    pub(super) first: u32,
}

impl Point {
    /// In pixels from the upper left corner.
    pub(super) fn place(&self) -> DVec2 {
        DVec2::new(f64::from(self.x), f64::from(self.y)) * (1.0 / f64::from(UNIT))
    }

    /// In the image plane, where the pixel's upper left corner is at `origin`.
    pub(super) fn from(&self, origin: PlanePoint) -> PlanePoint {
        PlanePoint { x: origin.x + i32::from(self.x), y: origin.y - i32::from(self.y) }
    }

    /// Whether it is on the pixel's side.
    pub(super) fn shared(&self) -> bool {
        [self.x, self.y].into_iter().any(|c| c == 0 || i32::from(c) == UNIT)
    }
}

/// A rectangle of a pixel, in lattice units from its upper left corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    x: u16,
    y: u16,
    width: u16,
    height: u16,
    /// The points at its corners, clockwise from the upper left one.
    pub(super) corners: [u32; 4],
    /// The variance that its corners are taken to have at least, however alike they are.
    pub(super) inherited: f64,
    /// What is thought of its mean, if that is known yet.
    pub(super) error: Option<Error>,
}

impl Cell {
    /// Its share of the pixel.
    pub(super) fn area(&self) -> f64 {
        f64::from(self.width) * f64::from(self.height) / (f64::from(UNIT) * f64::from(UNIT))
    }

    /// Whether a place in pixels is in it.
    pub(super) fn contains(&self, at: DVec2) -> bool {
        let within = |c: f64, from: u16, size: u16| {
            let c = c * f64::from(UNIT) - f64::from(from);
            c >= 0.0 && c <= f64::from(size)
        };
        within(at.x, self.x, self.width) && within(at.y, self.y, self.height)
    }

    /// Whether it may be halved.
    pub(super) fn divisible(&self) -> bool {
        self.width.min(self.height) > SHORTEST
    }

    /// Whether it should be cut into a left and a right half, where it differs so much (in squares) from
    /// left to right and from top to bottom.
    pub(super) fn upright(&self, across: f32, down: f32) -> bool {
        let (w, h) = (f32::from(self.width), f32::from(self.height));
        if w > 2.0 * h || h > 2.0 * w {
            return w > h;
        }
        across * w * w > down * h * h || across * w * w == down * h * h && w > h
    }
}

/// How a cell is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cut {
    /// How often it is halved, and its halves again.
    pub(super) times: u32,
    /// Whether first into a left and a right half.
    pub(super) upright: bool,
    /// Whether always the same way: an edge along an axis makes all cells that it passes err alike, so they had
    /// better be few.
    pub(super) along: bool,
}

/// The cells of a pixel, side by side, in no particular order.
#[derive(Default)]
pub(super) struct Cells {
    pub(super) cells: Vec<Cell>,
    pub(super) points: Vec<Point>,
    /// The first of the points that are not asked for yet.
    fresh: usize,
    /// Answers awaited: the point, and where its answer will be.
    pub(super) asked: Vec<(u32, u32)>,
    /// Of every small thing that was seen, how far the nearest of so many points is from what it shows.
    pub(super) near: Vec<f64>,
    pub(super) compared: usize,
    /// Whether answers are whole paths.
    pub(super) whole: bool,
    /// Places of points by their coordinates. Every pixel has its own: small ones stay at hand.
    index: Index<u32>,
}

impl Cells {
    /// Begins with a pixel of which the corners are known, clockwise from the upper left one: what they show, and
    /// what they meet first. Memory is used again.
    pub(super) fn begin(&mut self, corners: [(DVec3, u32); 4]) {
        let unit = UNIT as u16;
        let places = [(0, 0), (unit, 0), (unit, unit), (0, unit)];
        let points = places.into_iter().zip(corners);
        let root = Cell { x: 0, y: 0, width: unit, height: unit, corners: [0, 1, 2, 3], inherited: 0.0, error: None };
        self.cells.clear();
        self.cells.push(root);
        self.points.clear();
        self.points.extend(points.map(|((x, y), (open, first))| Point { x, y, open, first }));
        self.fresh = 4;
        self.asked.clear();
        self.near.clear();
        self.compared = 0;
        self.index.clear();
    }

    /// Halves cells, each as its cut says.
    pub(super) fn cut(&mut self, cuts: &[(usize, Cut)]) {
        for &(at, cut) in cuts {
            let cell = self.cells[at];
            let inherited = cell.error.map_or(0.0, |e| e.spread);
            self.halve(Some(at), Cell { inherited, error: None, ..cell }, cut);
        }
    }

    /// The points that are not asked for yet.
    pub(super) fn take_fresh(&mut self) -> Range<usize> {
        let fresh = self.fresh..self.points.len();
        self.fresh = fresh.end;
        self.asked.reserve(fresh.len());
        fresh
    }

    /// Puts what comes of `cell` at the place `at` first, then behind all others.
    fn halve(&mut self, at: Option<usize>, cell: Cell, cut: Cut) {
        if cut.times == 0 || !cell.divisible() {
            match at {
                Some(at) => self.cells[at] = cell,
                None => self.cells.push(cell),
            }
            return;
        }
        let cell = Cell { inherited: INHERITED * cell.inherited, ..cell };
        let [a, b, c, d] = cell.corners;
        let (w, h) = (cell.width / 2, cell.height / 2);
        let (one, other) = if cut.upright {
            let top = self.point(cell.x + w, cell.y);
            let bottom = self.point(cell.x + w, cell.y + cell.height);
            (
                Cell { width: w, corners: [a, top, bottom, d], ..cell },
                Cell { x: cell.x + w, width: w, corners: [top, b, c, bottom], ..cell },
            )
        } else {
            let left = self.point(cell.x, cell.y + h);
            let right = self.point(cell.x + cell.width, cell.y + h);
            (
                Cell { height: h, corners: [a, b, right, left], ..cell },
                Cell { y: cell.y + h, height: h, corners: [left, right, c, d], ..cell },
            )
        };
        for (at, half) in [(at, one), (None, other)] {
            let upright = if cut.along { cut.upright } else { half.upright(0.0, 0.0) };
            self.halve(at, half, Cut { times: cut.times - 1, upright, ..cut });
        }
    }

    /// The point at (x, y).
    fn point(&mut self, x: u16, y: u16) -> u32 {
        let new = self.points.len() as u32;
        let at = *self.index.entry(u32::from(x) << 16 | u32::from(y)).or_insert(new);
        if at == new {
            self.points.push(Point { x, y, open: DVec3::ZERO, first: NONE });
        }
        at
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A pixel that nothing is known of.
    pub(in crate::sampling) fn pixel() -> Cells {
        let mut cells = Cells::default();
        cells.begin([(DVec3::ZERO, NONE); 4]);
        cells
    }

    #[test]
    fn cells_cover_the_pixel() {
        let mut cells = pixel();
        cells.cut(&[(0, Cut { times: 2, upright: true, along: false })]);
        assert_eq!((cells.cells.len(), cells.points.len()), (4, 9));
        cells.cut(&[(1, Cut { times: 3, upright: false, along: false })]);
        assert_eq!(cells.cells.len(), 11);
        assert_eq!(cells.cells.iter().map(Cell::area).sum::<f64>(), 1.0);
    }

    #[test]
    fn cells_that_touch_share_points() {
        let mut cells = pixel();
        cells.cut(&[(0, Cut { times: 1, upright: true, along: false })]);
        assert_eq!(cells.points.len(), 6);
        cells.cut(&[(0, Cut { times: 1, upright: false, along: false })]);
        assert_eq!(cells.points.len(), 8);
        // The side between the halves is known in its middle.
        cells.cut(&[(1, Cut { times: 1, upright: false, along: false })]);
        assert_eq!(cells.points.len(), 9);
    }

    #[test]
    fn nothing_is_left_of_the_pixel_before() {
        let mut cells = pixel();
        cells.cut(&[(0, Cut { times: 4, upright: true, along: false })]);
        cells.begin([(DVec3::ONE, 7); 4]);
        cells.cut(&[(0, Cut { times: 1, upright: true, along: false })]);
        assert_eq!((cells.cells.len(), cells.points.len(), cells.take_fresh()), (2, 6, 4..6));
        assert!(cells.points[..4].iter().all(|p| p.first == 7) && cells.asked.is_empty());
    }

    #[test]
    fn halving_ends() {
        let mut cells = pixel();
        for _ in 0..40 {
            // Always the first cell alone.
            cells.cut(&[(0, Cut { times: 1, upright: cells.cells[0].upright(0.0, 0.0), along: false })]);
        }
        assert!(!cells.cells[0].divisible());
        assert_eq!(cells.cells.len(), 20);
    }
}
