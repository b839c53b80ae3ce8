//! A binary hierarchy by binned SAH. It sees only boxes and kinds.

use super::Coordinate;

/// Something to be found: a box, an id, and the kind of leaf it may lie in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item<T> {
    pub(crate) lo: [T; 3],
    pub(crate) hi: [T; 3],
    pub(crate) id: u32,
    pub(crate) kind: u8,
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
/// What a step down costs, in intersection tests.
const STEP_COST: f64 = 1.5;

#[derive(Clone, Copy)]
struct Bin<T> {
    bounds: Bounds<T>,
    count: u32,
}

struct Bins<T>([[Bin<T>; BINS]; 3]);

impl<T: Coordinate> Bins<T> {
    fn new() -> Self {
        Self([[Bin { bounds: Bounds::EMPTY, count: 0 }; BINS]; 3])
    }

    fn fill(mut self, items: &[Item<T>], scale: &Scale) -> Self {
        for item in items {
            for k in 0..3 {
                let bin = &mut self.0[k][scale.bin(item, k)];
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
    fn bin<T: Coordinate>(&self, item: &Item<T>, k: usize) -> usize {
        let c = item.lo[k].to_f64() + item.hi[k].to_f64();
        // `as` saturates, and sends NaN (an infinite extent) to 0.
        (((c - self.origin[k]) * self.factor[k]) as usize).min(BINS - 1)
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
            let c = i.lo[k].to_f64() + i.hi[k].to_f64();
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
        let key = |i: &Item<T>| i.lo[k].to_f64() + i.hi[k].to_f64();
        items.sort_unstable_by(|a, b| key(a).total_cmp(&key(b)).then(a.id.cmp(&b.id)));
        return Some((0.0, items.len() / 2));
    }
    // Most nodes are small ones, where the bins would cost more than the items in them.
    let count = if items.len() > FEW { BINS } else { BINS / 2 };
    let scale = Scale { origin: lo, factor: [0, 1, 2].map(|k| count as f64 * (1.0 - 1e-9) / (hi[k] - lo[k])) };
    let bins = if items.len() > 8 * PARALLEL {
        use rayon::prelude::*;
        items
            .par_chunks(2 * PARALLEL)
            .map(|c| Bins::new().fill(c, &scale))
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
        let mut right = [0.0; BINS];
        let (mut b, mut n) = (Bounds::EMPTY, 0);
        for i in (1..count).rev() {
            let bin = &bins.0[k][i];
            b.add(&bin.bounds.lo, &bin.bounds.hi);
            n += bin.count;
            right[i] = b.half_area() * f64::from(n);
        }
        let (mut b, mut n) = (Bounds::EMPTY, 0);
        for i in 1..count {
            let bin = &bins.0[k][i - 1];
            b.add(&bin.bounds.lo, &bin.bounds.hi);
            n += bin.count;
            let cost = b.half_area() * f64::from(n) + right[i];
            if n > 0 && (n as usize) < items.len() && best.is_none_or(|(c, ..)| cost < c) {
                best = Some((cost, k, i));
            }
        }
    }
    let (cost, axis, at) = best?;
    let middle = partition(items, |i| scale.bin(i, axis) < at);
    let area = bounds.half_area();
    Some((if area > 0.0 { STEP_COST + cost / area } else { f64::INFINITY }, middle))
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
