//! A binary hierarchy by binned SAH. It sees only boxes and kinds.

use super::Coordinate;
use crate::simd::Level;

/// Something to be found: a box, an id, and the kind of leaf it may lie in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item<T> {
    pub(crate) lo: [T; 3],
    pub(crate) hi: [T; 3],
    pub(crate) id: u32,
    pub(crate) kind: u8,
}

impl<T: Coordinate> Item<T> {
    /// Twice the centre.
    #[inline(always)]
    fn center(&self, k: usize) -> f64 {
        self.lo[k].to_f64() + self.hi[k].to_f64()
    }
}

/// A node of the binary hierarchy.
#[derive(Debug)]
pub(crate) enum Binary<T> {
    Leaf { bounds: Bounds<T>, start: u32, count: u32 },
    Inner { bounds: Bounds<T>, children: Box<[Binary<T>; 2]> },
}

impl<T: Coordinate> Binary<T> {
    pub(crate) fn bounds(&self) -> &Bounds<T> {
        match self {
            Self::Leaf { bounds, .. } | Self::Inner { bounds, .. } => bounds,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds<T> {
    pub(crate) lo: [T; 3],
    pub(crate) hi: [T; 3],
}

impl<T: Coordinate> Bounds<T> {
    const EMPTY: Self = Self { lo: [T::INFINITY; 3], hi: [T::NEG_INFINITY; 3] };

    fn add(&mut self, lo: &[T; 3], hi: &[T; 3]) {
        for k in 0..3 {
            self.lo[k] = self.lo[k].least(lo[k]);
            self.hi[k] = self.hi[k].greatest(hi[k]);
        }
    }

    pub(crate) fn half_area(&self) -> f64 {
        let e = [0, 1, 2].map(|k| self.hi[k].to_f64() - self.lo[k].to_f64());
        if e[0] < 0.0 { 0.0 } else { e[0] * e[1] + e[1] * e[2] + e[2] * e[0] }
    }
}

const BINS: usize = 16;
/// Up to this many items half the bins serve.
const FEW: usize = 32;
/// Below this many items a subtree is built by one thread.
const PARALLEL: usize = 4096;
/// The most items of a leaf.
pub(crate) const MAX_LEAF: usize = 8;
/// What a step down costs, in intersection tests: twice as wide registers make tests cheaper, but
/// not the wait for a node's memory.
fn step_cost() -> f64 {
    if Level::best() == Level::Avx512 { 2.5 } else { 1.5 }
}

#[derive(Clone, Copy)]
struct Bin<T> {
    bounds: Bounds<T>,
    count: u32,
}

/// B bins on each axis.
struct Bins<T, const B: usize>([[Bin<T>; B]; 3]);

impl<T: Coordinate, const B: usize> Bins<T, B> {
    fn new() -> Self {
        Self([[Bin { bounds: Bounds::EMPTY, count: 0 }; B]; 3])
    }

    fn fill(mut self, items: &[Item<T>], scale: &Scale) -> Self {
        for item in items {
            for k in 0..3 {
                let bin = &mut self.0[k][scale.bin::<T, B>(item, k)];
                bin.bounds.add(&item.lo, &item.hi);
                bin.count += 1;
            }
        }
        self
    }

    fn merge(mut self, other: &Self) -> Self {
        for (a, b) in self.0.as_flattened_mut().iter_mut().zip(other.0.as_flattened()) {
            a.bounds.add(&b.bounds.lo, &b.bounds.hi);
            a.count += b.count;
        }
        self
    }
}

/// From an item's centre (doubled: lo + hi) to its bin on each axis.
struct Scale {
    origin: [f64; 3],
    factor: [f64; 3],
}

impl Scale {
    fn new(lo: [f64; 3], hi: [f64; 3], bins: usize) -> Self {
        Self { origin: lo, factor: [0, 1, 2].map(|k| bins as f64 * (1.0 - 1e-9) / (hi[k] - lo[k])) }
    }

    #[inline(always)]
    fn bin<T: Coordinate, const B: usize>(&self, item: &Item<T>, k: usize) -> usize {
        // `as` saturates, and sends NaN (an infinite extent) to 0.
        (((item.center(k) - self.origin[k]) * self.factor[k]) as usize).min(B - 1)
    }
}

/// Orders `items` into leaves and returns the hierarchy over them; `None` for no items.
pub(crate) fn build_binary<T: Coordinate>(items: &mut [Item<T>]) -> Option<Binary<T>> {
    if items.is_empty() { None } else { Some(node(items, 0, 0)) }
}

fn bounds_of<T: Coordinate>(items: &[Item<T>]) -> (Bounds<T>, [f64; 3], [f64; 3]) {
    let mut bounds = Bounds::EMPTY;
    let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for i in items {
        bounds.add(&i.lo, &i.hi);
        for k in 0..3 {
            let c = i.center(k);
            lo[k] = lo[k].min(c);
            hi[k] = hi[k].max(c);
        }
    }
    (bounds, lo, hi)
}

fn node<T: Coordinate>(items: &mut [Item<T>], start: u32, depth: u32) -> Binary<T> {
    let n = items.len();
    let (bounds, lo, hi) = bounds_of(items);
    let pure = items.iter().all(|i| i.kind == items[0].kind);
    let leaf = Binary::Leaf { bounds, start, count: n as u32 };
    if n == 1 {
        return leaf;
    }
    let split = split(items, &bounds, lo, hi, depth);
    let middle = match split {
        Some((cost, middle)) if !(pure && n <= MAX_LEAF && cost >= n as f64) => middle,
        _ if pure && n <= MAX_LEAF => return leaf,
        Some((_, middle)) => middle,
        None if !pure => {
            items.sort_unstable_by_key(|i| (i.kind, i.id));
            items.partition_point(|i| i.kind == items[0].kind)
        }
        // Equal centres: any halves are as good, ids make them the same halves always.
        None => {
            items.sort_unstable_by_key(|i| i.id);
            n / 2
        }
    };
    let (a, b) = items.split_at_mut(middle);
    let at = start + middle as u32;
    let children = if n > PARALLEL {
        rayon::join(|| node(a, start, depth + 1), || node(b, at, depth + 1))
    } else {
        (node(a, start, depth + 1), node(b, at, depth + 1))
    };
    Binary::Inner { bounds, children: Box::new([children.0, children.1]) }
}

/// Partitions `items` where SAH is least; its cost in intersection tests and the size of the first half.
fn split<T: Coordinate>(
    items: &mut [Item<T>],
    bounds: &Bounds<T>,
    lo: [f64; 3],
    hi: [f64; 3],
    depth: u32,
) -> Option<(f64, usize)> {
    // Very uneven scenes could make a tree as deep as it has items; halving by count ends that.
    if depth > 60 {
        let k = (0..3).max_by(|&a, &b| (hi[a] - lo[a]).total_cmp(&(hi[b] - lo[b])))?;
        items.sort_unstable_by(|a, b| a.center(k).total_cmp(&b.center(k)).then(a.id.cmp(&b.id)));
        return Some((0.0, items.len() / 2));
    }
    // Most nodes are small ones, where the bins would cost more than the items in them.
    let (cost, middle) = match items.len() {
        2 => split_two(items, lo, hi)?,
        n if n <= FEW => split_bins::<T, { BINS / 2 }>(items, lo, hi)?,
        _ => split_bins::<T, BINS>(items, lo, hi)?,
    };
    let area = bounds.half_area();
    Some((if area > 0.0 { step_cost() + cost / area } else { f64::INFINITY }, middle))
}

/// What bins would make of two items.
fn split_two<T: Coordinate>(items: &mut [Item<T>], lo: [f64; 3], hi: [f64; 3]) -> Option<(f64, usize)> {
    let scale = Scale::new(lo, hi, BINS / 2);
    let k = (0..3).find(|&k| hi[k] > lo[k] && scale.factor[k].is_finite() && scale.factor[k] > 0.0)?;
    if items[1].center(k) < items[0].center(k) {
        items.swap(0, 1);
    }
    let area = |i: &Item<T>| Bounds { lo: i.lo, hi: i.hi }.half_area();
    Some((area(&items[0]) + area(&items[1]), 1))
}

fn split_bins<T: Coordinate, const B: usize>(
    items: &mut [Item<T>],
    lo: [f64; 3],
    hi: [f64; 3],
) -> Option<(f64, usize)> {
    let scale = Scale::new(lo, hi, B);
    let bins = if items.len() > 8 * PARALLEL {
        use rayon::prelude::*;
        items
            .par_chunks(2 * PARALLEL)
            .map(|c| Bins::<T, B>::new().fill(c, &scale))
            .reduce_with(|a, b| a.merge(&b))
            .unwrap_or_else(Bins::new)
    } else {
        Bins::new().fill(items, &scale)
    };
    let mut best: Option<(f64, usize, usize)> = None;
    for k in 0..3 {
        if !(hi[k] > lo[k]) || !scale.factor[k].is_finite() {
            continue;
        }
        let bins = &bins.0[k];
        let mut right = [0.0; B];
        let (mut b, mut n, mut cost) = (Bounds::EMPTY, 0, 0.0);
        for i in (1..B).rev() {
            // An empty bin changes nothing.
            if bins[i].count > 0 {
                b.add(&bins[i].bounds.lo, &bins[i].bounds.hi);
                n += bins[i].count;
                cost = b.half_area() * f64::from(n);
            }
            right[i] = cost;
        }
        let (mut b, mut n) = (Bounds::EMPTY, 0);
        for i in 1..B {
            let bin = &bins[i - 1];
            if bin.count == 0 {
                continue;
            }
            b.add(&bin.bounds.lo, &bin.bounds.hi);
            n += bin.count;
            let cost = b.half_area() * f64::from(n) + right[i];
            if (n as usize) < items.len() && best.is_none_or(|(c, ..)| cost < c) {
                best = Some((cost, k, i));
            }
        }
    }
    let (cost, axis, at) = best?;
    Some((cost, partition(items, |i| scale.bin::<T, B>(i, axis) < at)))
}

/// Moves what satisfies `first` to the front, as the items' order alone decides; returns how many.
fn partition<T>(items: &mut [T], first: impl Fn(&T) -> bool) -> usize {
    let (mut i, mut j) = (0, items.len());
    loop {
        while i < j && first(&items[i]) {
            i += 1;
        }
        while i < j && !first(&items[j - 1]) {
            j -= 1;
        }
        if i >= j {
            return i;
        }
        items.swap(i, j - 1);
    }
}
