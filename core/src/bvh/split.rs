//! Where a run of items is best cut in two: binned SAH.

use rayon::prelude::*;

use super::coordinate::{Coordinate, Quad};

/// A box; the fourth lane holds what a tag makes of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds<T: Coordinate> {
    pub(super) lo: T::Quad,
    pub(super) hi: T::Quad,
}

impl<T: Coordinate> Bounds<T> {
    fn empty() -> Self {
        Self { lo: T::Quad::splat(T::INFINITY), hi: T::Quad::splat(T::NEG_INFINITY) }
    }

    #[inline(always)]
    fn and(self, b: &Self) -> Self {
        Self { lo: self.lo.least(b.lo), hi: self.hi.greatest(b.hi) }
    }

    /// Half the surface; of nothing, 0.
    #[inline(always)]
    pub(super) fn half_area(&self) -> T {
        let [x, y, z] = (self.hi - self.lo).greatest(T::Quad::splat(T::ZERO)).xyz();
        x * (y + z) + y * z
    }
}

/// Something to be found: its box, with its tag in the fourth lane of both ends.
pub(crate) type Item<T> = Bounds<T>;

impl<T: Coordinate> Item<T> {
    pub(crate) fn new(lo: [T; 3], hi: [T; 3], tag: u32) -> Self {
        let quad = |[x, y, z]: [T; 3]| T::Quad::new([x, y, z, T::from_tag(tag)]);
        Self { lo: quad(lo), hi: quad(hi) }
    }

    #[inline(always)]
    pub(crate) fn tag(&self) -> u32 {
        self.lo.lanes()[3].tag()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.lo.lanes()[0] > self.hi.lanes()[0]
    }

    /// Twice the centre.
    #[inline(always)]
    pub(super) fn center(&self) -> T::Quad {
        self.lo + self.hi
    }
}

/// Items that follow one another.
#[derive(Clone, Debug)]
pub(super) struct Run<T: Coordinate> {
    pub(super) start: usize,
    pub(super) len: usize,
    /// Cuts that led to it.
    pub(super) depth: u32,
    pub(super) bounds: Bounds<T>,
    /// The box of twice the centres.
    pub(super) centers: Bounds<T>,
    /// Where it has been cut already.
    pub(super) halves: Option<Box<[Run<T>; 2]>>,
}

/// From so many items on, all threads look through them.
const MANY: usize = 1 << 15;

impl<T: Coordinate> Run<T> {
    pub(super) fn new(items: &[Item<T>], start: usize, depth: u32) -> Self {
        let look = |items: &[Item<T>]| {
            let (mut bounds, mut centers) = (Bounds::empty(), Bounds::empty());
            for item in items {
                let c = item.center();
                bounds = bounds.and(item);
                centers = centers.and(&Bounds { lo: c, hi: c });
            }
            (bounds, centers)
        };
        let (bounds, centers) = if items.len() > MANY {
            items.par_chunks(MANY / 4).map(look).reduce(|| look(&[]), |a, b| (a.0.and(&b.0), a.1.and(&b.1)))
        } else {
            look(items)
        };
        Self { start, len: items.len(), depth, bounds, centers, halves: None }
    }
}

/// A cut: on `axis` before bin `at`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut<T: Coordinate> {
    scale: Scale<T>,
    axis: usize,
    at: usize,
    /// Half areas times items of the two sides.
    pub(super) cost: T,
}

const BINS: usize = 16;
/// Up to this many items half the bins serve.
const FEW: usize = 32;

/// From an item's centre to its bin on each axis.
#[derive(Clone, Copy, Debug)]
struct Scale<T: Coordinate> {
    origin: T::Quad,
    factor: T::Quad,
    last: T,
}

impl<T: Coordinate> Scale<T> {
    fn new(centers: &Bounds<T>, bins: usize) -> Self {
        let factor = (centers.hi - centers.lo).lanes().map(|extent| T::near(bins as f64 / extent.to_f64()));
        Self { origin: centers.lo, factor: T::Quad::new(factor), last: T::near((bins - 1) as f64) }
    }

    /// Whether the axis tells items apart.
    fn divides(&self, axis: usize) -> bool {
        let factor = self.factor.lanes()[axis];
        factor > T::ZERO && factor < T::INFINITY
    }

    /// Rounded down but for exact halves. NaN, of axes that do not divide, goes to the first bin.
    #[inline(always)]
    fn bins(&self, item: &Item<T>) -> [usize; 3] {
        let at = (item.center() - self.origin) * self.factor - T::Quad::splat(T::near(0.5));
        let at = at.greatest(T::Quad::splat(T::ZERO)).least(T::Quad::splat(self.last));
        (at + T::Quad::splat(T::WHOLE)).xyz().map(T::whole)
    }
}

/// B bins on each axis.
struct Bins<T: Coordinate, const B: usize> {
    bounds: [[Bounds<T>; B]; 3],
    counts: [[u32; B]; 3],
}

impl<T: Coordinate, const B: usize> Bins<T, B> {
    fn fill(items: &[Item<T>], scale: &Scale<T>) -> Self {
        let mut bins = Self { bounds: [[Bounds::empty(); B]; 3], counts: [[0; B]; 3] };
        for item in items {
            let at = scale.bins(item);
            for k in 0..3 {
                let at = at[k] % B;
                bins.bounds[k][at] = bins.bounds[k][at].and(item);
                bins.counts[k][at] += 1;
            }
        }
        bins
    }

    fn merge(mut self, other: &Self) -> Self {
        for k in 0..3 {
            for i in 0..B {
                self.bounds[k][i] = self.bounds[k][i].and(&other.bounds[k][i]);
                self.counts[k][i] += other.counts[k][i];
            }
        }
        self
    }

    /// The least cost among the cuts on `axis`, and its bin.
    fn best(&self, axis: usize) -> (T, usize) {
        let (bounds, counts) = (&self.bounds[axis], &self.counts[axis]);
        let mut right = [T::ZERO; B];
        let (mut b, mut n) = (Bounds::empty(), 0);
        for i in (1..B).rev() {
            b = b.and(&bounds[i]);
            n += counts[i];
            right[i] = b.half_area() * T::near(f64::from(n));
        }
        let mut best = (T::INFINITY, 1);
        let (mut b, mut n) = (Bounds::empty(), 0);
        for i in 1..B {
            b = b.and(&bounds[i - 1]);
            n += counts[i - 1];
            let cost = b.half_area() * T::near(f64::from(n)) + right[i];
            if cost < best.0 {
                best = (cost, i);
            }
        }
        best
    }
}

/// The cut of least cost; `None` where no axis tells the items apart.
pub(super) fn cut<T: Coordinate>(items: &[Item<T>], run: &Run<T>) -> Option<Cut<T>> {
    // Most runs are short ones, where the bins would cost more than the items in them.
    match items.len() {
        2 => cut_two(items, run),
        n if n <= FEW => cut_bins::<T, { BINS / 2 }>(items, run),
        _ => cut_bins::<T, BINS>(items, run),
    }
}

fn cut_two<T: Coordinate>(items: &[Item<T>], run: &Run<T>) -> Option<Cut<T>> {
    let scale = Scale::new(&run.centers, 2);
    let axis = (0..3).find(|&k| scale.divides(k))?;
    Some(Cut { scale, axis, at: 1, cost: items[0].half_area() + items[1].half_area() })
}

fn cut_bins<T: Coordinate, const B: usize>(items: &[Item<T>], run: &Run<T>) -> Option<Cut<T>> {
    let scale = Scale::new(&run.centers, B);
    let fill = |items: &[Item<T>]| Bins::<T, B>::fill(items, &scale);
    let bins = if items.len() > MANY {
        items.par_chunks(MANY / 4).map(fill).reduce_with(|a, b| a.merge(&b))?
    } else {
        fill(items)
    };
    let mut best: Option<Cut<T>> = None;
    for axis in (0..3).filter(|&k| scale.divides(k)) {
        let (cost, at) = bins.best(axis);
        if best.is_none_or(|b| cost < b.cost) {
            best = Some(Cut { scale, axis, at, cost });
        }
    }
    best
}

impl<T: Coordinate> Cut<T> {
    /// Moves what lies before the cut to the front; gives how many that are.
    pub(super) fn partition(&self, items: &mut [Item<T>]) -> usize {
        let (scale, axis) = (&self.scale, self.axis);
        let (origin, factor) = (scale.origin.lanes()[axis], scale.factor.lanes()[axis]);
        let end = T::near(self.at as f64) + T::WHOLE;
        let mut first = 0;
        // Every item is moved, which costs less than guessing wrongly which ones need not be.
        for i in 0..items.len() {
            let center = items[i].lo.lanes()[axis] + items[i].hi.lanes()[axis];
            // As `Scale::bins` has it.
            let before = (center - origin) * factor - T::near(0.5) + T::WHOLE < end;
            items.swap(i, first);
            first += usize::from(before);
        }
        first
    }
}
