//! From items to nodes, from the root down.
//!
//! A node's run of items is cut in two, then the largest run that can be cut, until there are
//! eight or none can be.

use std::cmp::Ordering;

use rayon::prelude::*;

use super::coordinate::{Coordinate, Quad};
use super::split::{Item, Run, cut};
use super::tree::{Bvh, Child, KINDS, Node, WIDTH};

/// The most items of a leaf.
const MAX_LEAF: usize = 8;
/// More items have more nodes than a second-level cache holds.
const MANY: usize = 1 << 16;
/// Up to this many items one thread builds what is below a node.
const ALONE: usize = 4096;
/// Runs of more items are cut before it is known which node will have them: both halves at once.
const AHEAD: usize = ALONE / 8;
/// Cuts after which runs are halved by count: very uneven scenes could make a tree as deep as it
/// has items.
const DEEP: u32 = 60;

/// Of items in one box, so many are held against each other.
const ALIKE: usize = 64;

/// What is built of all items alike.
pub(crate) struct Builder<'a> {
    /// Where kinds end, by falling tags: from the first on, tags are of kind 0, below the last, of the last kind.
    ends: [u32; KINDS - 1],
    /// Whether the first never matters beside the second, where both have the same box.
    hidden: &'a (dyn Fn(u32, u32) -> bool + Sync),
    /// What a step down costs, in intersection tests.
    step: f64,
}

/// What becomes of a run.
enum Fate<T: Coordinate> {
    Open,
    Leaf,
    Node([Run<T>; 2]),
}

/// What is built by itself: the node over `runs`, child `slot` of node `parent`.
struct Task<T: Coordinate> {
    runs: [Run<T>; 2],
    parent: usize,
    slot: usize,
}

impl<'a> Builder<'a> {
    /// For `count` items; see the fields.
    pub(crate) fn new(ends: [u32; KINDS - 1], count: usize, hidden: &'a (dyn Fn(u32, u32) -> bool + Sync)) -> Self {
        // Tests are cheap in wide registers; the wait for a node's memory is longer where nodes are many. The same
        // for any processor: what is sampled depends on which boxes a beam meets, and so on the hierarchy.
        let step = if count > MANY { 4.5 } else { 3.5 };
        Self { ends, hidden, step }
    }

    /// The hierarchy over `items`, which are put in another order. Uses the calling rayon pool.
    pub(crate) fn build<T: Coordinate>(&self, items: &mut [Item<T>]) -> Bvh<T> {
        let mut bvh = Bvh::default();
        if items.is_empty() {
            return bvh;
        }
        let mut root = Run::new(items, 0, 0);
        bvh.lo = root.bounds.lo.xyz().map(T::to_f64);
        bvh.hi = root.bounds.hi.xyz().map(T::to_f64);
        self.cut_ahead(items, &mut root);
        let Some(runs) = self.divide(items, 0, &mut root) else {
            let mut node = Node::default();
            let leaf = self.leaf(&items[..root.len], &mut bvh);
            node.set(0, &root.bounds, leaf);
            bvh.nodes.push(node);
            return bvh;
        };
        let mut tasks = (items.len() > ALONE).then(Vec::new);
        self.node(items, 0, runs, &mut bvh, &mut tasks);
        let Some(tasks) = tasks else { return bvh };
        let mut rest = (items, 0);
        let mut work = Vec::with_capacity(tasks.len());
        for Task { runs, parent, slot } in tasks {
            let (start, len) = (runs[0].start, runs[0].len + runs[1].len);
            let (own, behind) = rest.0.split_at_mut(start - rest.1).1.split_at_mut(len);
            rest = (behind, start + len);
            work.push((own, runs, (parent, slot)));
        }
        let parts: Vec<_> = work
            .into_par_iter()
            .map(|(items, runs, place)| {
                let mut part = Bvh::default();
                self.node(items, runs[0].start, runs, &mut part, &mut None);
                (part, place)
            })
            .collect();
        bvh.with(parts)
    }

    fn kind(&self, tag: u32) -> u8 {
        self.ends.iter().map(|&end| u8::from(tag < end)).sum()
    }

    /// Cuts `run`, whose items are `items`, and what comes of it, into runs of a few.
    fn cut_ahead<T: Coordinate>(&self, items: &mut [Item<T>], run: &mut Run<T>) {
        if run.len <= AHEAD {
            return;
        }
        let Some([mut a, mut b]) = self.divide(items, run.start, run) else { return };
        let (left, right) = items.split_at_mut(a.len);
        rayon::join(|| self.cut_ahead(left, &mut a), || self.cut_ahead(right, &mut b));
        run.halves = Some(Box::new([a, b]));
    }

    /// Cuts `run` in two; `None` where it is better left as a leaf. The items' first has the number `base`.
    fn divide<T: Coordinate>(&self, items: &mut [Item<T>], base: usize, run: &mut Run<T>) -> Option<[Run<T>; 2]> {
        if let Some(halves) = run.halves.take() {
            return Some(*halves);
        }
        let items = &mut items[run.start - base..][..run.len];
        let ends = [run.bounds.lo, run.bounds.hi].map(|end| self.kind(end.lanes()[3].tag()));
        let leaf = ends[0] == ends[1] && run.len <= MAX_LEAF;
        if run.len == 1 {
            return None;
        }
        let middle = if run.depth > DEEP {
            if leaf {
                return None;
            }
            self.halve(items, run)
        } else {
            match cut(items, run) {
                Some(cut) if !leaf || self.pays(cut.cost, run) => cut.partition(items),
                Some(_) => return None,
                None if leaf => return None,
                // Equal centres.
                None => {
                    run.len = self.drop_hidden(items);
                    if run.len <= MAX_LEAF && items[..run.len].iter().all(|i| self.kind(i.tag()) == ends[0]) {
                        return None;
                    }
                    self.sort(&mut items[..run.len])
                }
            }
        };
        let (a, b) = items[..run.len].split_at(middle);
        let depth = run.depth + 1;
        Some([Run::new(a, run.start, depth), Run::new(b, run.start + middle, depth)])
    }

    /// Whether a cut costs less than the tests of all items.
    fn pays<T: Coordinate>(&self, cost: T, run: &Run<T>) -> bool {
        let area = run.bounds.half_area();
        area > T::ZERO && self.step + cost.to_f64() / area.to_f64() < run.len as f64
    }

    /// Puts kinds apart, or else halves; ids make them the same halves always.
    fn sort<T: Coordinate>(&self, items: &mut [Item<T>]) -> usize {
        items.sort_unstable_by_key(Item::tag);
        let kind = self.kind(items[0].tag());
        let middle = items.partition_point(|i| self.kind(i.tag()) == kind);
        if middle == items.len() { items.len() / 2 } else { middle }
    }

    /// Moves those that are not hidden to the front; says how many they are.
    fn drop_hidden<T: Coordinate>(&self, items: &mut [Item<T>]) -> usize {
        let key = |i: &Item<T>| [i.lo.xyz(), i.hi.xyz()].map(|end| end.map(T::to_f64));
        items.sort_unstable_by(|a, b| {
            let ends = key(a).into_iter().flatten().zip(key(b).into_iter().flatten());
            let boxes = ends.fold(Ordering::Equal, |o, (x, y)| o.then(x.total_cmp(&y)));
            boxes.then(a.tag().cmp(&b.tag()))
        });
        let (mut kept, mut first) = (0, 0);
        for i in 0..items.len() {
            if kept == 0 || key(&items[first]) != key(&items[i]) {
                first = kept;
            }
            // Others of the same box that are many are not worth the search: leaves look again.
            let others = &items[first..kept.min(first + ALIKE)];
            if !others.iter().any(|j| (self.hidden)(items[i].tag(), j.tag())) {
                items.swap(kept, i);
                kept += 1;
            }
        }
        kept
    }

    fn halve<T: Coordinate>(&self, items: &mut [Item<T>], run: &Run<T>) -> usize {
        let extent = (run.centers.hi - run.centers.lo).xyz().map(T::to_f64);
        let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
        let center = |i: &Item<T>| i.center().lanes()[axis].to_f64();
        items.sort_unstable_by(|a, b| center(a).total_cmp(&center(b)).then(a.tag().cmp(&b.tag())));
        items.len() / 2
    }

    /// The children of the node over `runs`.
    fn open<T: Coordinate>(&self, items: &mut [Item<T>], base: usize, runs: [Run<T>; 2]) -> Vec<(Run<T>, Fate<T>)> {
        let mut open = Vec::with_capacity(WIDTH);
        open.extend(runs.map(|run| (run, Fate::Open)));
        while open.len() < WIDTH {
            let undecided = (0..open.len()).filter(|&i| matches!(open[i].1, Fate::Open));
            let area = |i: usize| open[i].0.bounds.half_area();
            let Some(largest) = undecided.reduce(|a, b| if area(b) > area(a) { b } else { a }) else { break };
            match self.divide(items, base, &mut open[largest].0) {
                None => open[largest].1 = Fate::Leaf,
                Some([a, b]) => {
                    open[largest] = (a, Fate::Open);
                    open.insert(largest + 1, (b, Fate::Open));
                }
            }
        }
        for (run, fate) in &mut open {
            if matches!(fate, Fate::Open) {
                *fate = self.divide(items, base, run).map_or(Fate::Leaf, Fate::Node);
            }
        }
        open
    }

    /// Adds the node over `runs` and all below it; where there are `tasks`, what has few items becomes one
    /// of them.
    fn node<T: Coordinate>(
        &self,
        items: &mut [Item<T>],
        base: usize,
        runs: [Run<T>; 2],
        out: &mut Bvh<T>,
        tasks: &mut Option<Vec<Task<T>>>,
    ) -> Child {
        let parent = out.nodes.len();
        out.nodes.push(Node::default());
        for (slot, (run, fate)) in self.open(items, base, runs).into_iter().enumerate() {
            let link = match (fate, &mut *tasks) {
                (Fate::Open | Fate::Leaf, _) => self.leaf(&items[run.start - base..][..run.len], out),
                (Fate::Node(runs), Some(tasks)) if run.len <= ALONE => {
                    tasks.push(Task { runs, parent, slot });
                    Child::NOTHING
                }
                (Fate::Node(runs), _) => self.node(items, base, runs, out, tasks),
            };
            out.nodes[parent].set(slot, &run.bounds, link);
        }
        Child::inner(parent)
    }

    /// Adds the items of a leaf but those that are hidden.
    fn leaf<T: Coordinate>(&self, items: &[Item<T>], out: &mut Bvh<T>) -> Child {
        let kind = self.kind(items[0].tag());
        let ids = &mut out.ids[usize::from(kind)];
        let first = ids.len();
        // What coincides has the same box, which is at hand.
        let covers = |j: &Item<T>, i: &Item<T>| {
            j.lo.xyz() == i.lo.xyz() && j.hi.xyz() == i.hi.xyz() && (self.hidden)(i.tag(), j.tag())
        };
        let matters = |i: &&Item<T>| !items.iter().any(|j| covers(j, i));
        ids.extend(items.iter().filter(matters).map(Item::tag));
        Child::leaf(kind, first as u32, (ids.len() - first) as u32)
    }
}
