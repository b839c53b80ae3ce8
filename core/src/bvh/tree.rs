//! Nodes of eight children.

use rayon::prelude::*;

use super::coordinate::{Coordinate, Quad};
use super::split::Bounds;
use crate::simd::roomy;

/// Children of a node.
pub(crate) const WIDTH: usize = 8;

/// Kinds of items, of which a leaf has one. What they are is known to who builds and who walks, not here.
pub(crate) const KINDS: usize = 2;

/// A child: nothing, an inner node, or a run of items of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Child(u32);

/// A [`Child`], taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Link {
    Nothing,
    Inner(usize),
    Leaf { kind: u8, start: usize, count: usize },
}

impl Default for Child {
    fn default() -> Self {
        Self::NOTHING
    }
}

impl Child {
    pub(crate) const NOTHING: Self = Self(u32::MAX);
    /// Node 0.
    pub(crate) const ROOT: Self = Self(0);
    const LEAF: u32 = 1 << 31;
    /// Below it the kind, in as many bits as there are kinds for; then the count, in three; then the start.
    const KIND_SHIFT: u32 = 31 - (KINDS - 1).ilog2() - 1;
    const COUNT_SHIFT: u32 = Self::KIND_SHIFT - 3;

    pub(super) fn leaf(kind: u8, start: u32, count: u32) -> Self {
        debug_assert!((1..=8).contains(&count) && usize::from(kind) < KINDS);
        Self(Self::LEAF | u32::from(kind) << Self::KIND_SHIFT | ((count - 1) << Self::COUNT_SHIFT) | start)
    }

    pub(crate) fn inner(index: usize) -> Self {
        Self(index as u32)
    }

    pub(crate) fn link(self) -> Link {
        if self == Self::NOTHING {
            Link::Nothing
        } else if self.0 & Self::LEAF == 0 {
            Link::Inner(self.0 as usize)
        } else {
            Link::Leaf {
                kind: ((self.0 & !Self::LEAF) >> Self::KIND_SHIFT) as u8,
                start: (self.0 & ((1 << Self::COUNT_SHIFT) - 1)) as usize,
                count: ((self.0 >> Self::COUNT_SHIFT) & 7) as usize + 1,
            }
        }
    }
}

/// Eight boxes and what is in them; an absent child has an empty box.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node<T> {
    pub(crate) lo: [[T; WIDTH]; 3],
    pub(crate) hi: [[T; WIDTH]; 3],
    pub(crate) child: [Child; WIDTH],
}

impl<T: Coordinate> Default for Node<T> {
    fn default() -> Self {
        let (lo, hi) = ([[T::INFINITY; WIDTH]; 3], [[T::NEG_INFINITY; WIDTH]; 3]);
        Self { lo, hi, child: [Child::NOTHING; WIDTH] }
    }
}

impl<T: Coordinate> Node<T> {
    pub(super) fn set(&mut self, slot: usize, bounds: &Bounds<T>, child: Child) {
        for k in 0..3 {
            self.lo[k][slot] = bounds.lo.lanes()[k];
            self.hi[k][slot] = bounds.hi.lanes()[k];
        }
        self.child[slot] = child;
    }
}

/// The hierarchy; node 0 is the root. Empty where there are no items.
#[derive(Debug)]
pub(crate) struct Bvh<T> {
    pub(crate) nodes: Vec<Node<T>>,
    /// Ids of the items of each kind, in the order leaves name them.
    pub(crate) ids: [Vec<u32>; KINDS],
    /// Ends of the whole on each axis.
    pub(crate) lo: [f64; 3],
    pub(crate) hi: [f64; 3],
}

impl<T> Default for Bvh<T> {
    fn default() -> Self {
        Self { nodes: Vec::new(), ids: [const { Vec::new() }; KINDS], lo: [0.0; 3], hi: [0.0; 3] }
    }
}

impl<T: Coordinate> Bvh<T> {
    /// These nodes, and behind them those of `parts`, each below the child that its place names by
    /// node and slot.
    pub(super) fn with(mut self, parts: Vec<(Self, (usize, usize))>) -> Self {
        // The node and the ids that every part begins with, these nodes being the first.
        let mut begins = vec![(0, [0; KINDS])];
        let mut end = (self.nodes.len(), self.ids.each_ref().map(Vec::len));
        for (part, (parent, slot)) in &parts {
            self.nodes[*parent].child[*slot] = Child::inner(end.0);
            begins.push(end);
            end = (end.0 + part.nodes.len(), std::array::from_fn(|kind| end.1[kind] + part.ids[kind].len()));
        }
        let moved = |child: Child, (nodes, ids): (usize, [usize; KINDS])| match child.link() {
            Link::Nothing => child,
            Link::Inner(index) => Child::inner(nodes + index),
            Link::Leaf { kind, start, count } => {
                Child::leaf(kind, (ids[usize::from(kind)] + start) as u32, count as u32)
            }
        };
        let node = |i: usize| {
            let at = begins.partition_point(|b| b.0 <= i) - 1;
            let node = if at == 0 { &self.nodes[i] } else { &parts[at - 1].0.nodes[i - begins[at].0] };
            Node { child: node.child.map(|child| moved(child, begins[at])), ..*node }
        };
        // All threads together, for fresh memory takes longer than what is put there.
        let mut nodes = roomy(end.0);
        nodes.par_extend((0..end.0).into_par_iter().map(node));
        for (part, _) in &parts {
            for (all, more) in self.ids.iter_mut().zip(&part.ids) {
                all.extend(more);
            }
        }
        Self { nodes, ..self }
    }

    /// The farthest that a point in the hierarchy may be from the origin.
    pub(crate) fn radius(&self) -> f64 {
        let far = |k: usize| self.lo[k].abs().max(self.hi[k].abs());
        (far(0) * far(0) + far(1) * far(1) + far(2) * far(2)).sqrt()
    }

    /// A bound on |x| + |y| + |z| of every point in the hierarchy.
    pub(crate) fn reach(&self) -> f64 {
        (0..3).map(|k| self.lo[k].abs().max(self.hi[k].abs())).sum()
    }
}
