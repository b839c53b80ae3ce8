//! The binary hierarchy, collapsed to eight children a node.

use super::build::{Binary, Bounds};
use super::{Coordinate, Item};

/// Children of a node.
pub(crate) const WIDTH: usize = 8;

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

impl Child {
    pub(crate) const NOTHING: Self = Self(u32::MAX);
    /// Node 0.
    pub(crate) const ROOT: Self = Self(0);
    const LEAF: u32 = 1 << 31;
    const KIND: u32 = 1 << 30;
    const COUNT_SHIFT: u32 = 27;

    fn leaf(kind: u8, start: u32, count: u32) -> Self {
        debug_assert!((1..=8).contains(&count) && kind < 2);
        Self(Self::LEAF | if kind == 1 { Self::KIND } else { 0 } | ((count - 1) << Self::COUNT_SHIFT) | start)
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
                kind: u8::from(self.0 & Self::KIND != 0),
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

/// The hierarchy; node 0 is the root. Empty where there are no items.
#[derive(Debug)]
pub(crate) struct Wide<T> {
    pub(crate) nodes: Vec<Node<T>>,
    /// Ids of the items of each kind, in the order leaves name them.
    pub(crate) ids: [Vec<u32>; 2],
    /// Ends of the whole on each axis.
    pub(crate) lo: [f64; 3],
    pub(crate) hi: [f64; 3],
}

impl<T: Coordinate> Wide<T> {
    /// Leaves out what is `hidden` by another item of its leaf: `hidden(a, b)` says whether a never matters beside b.
    pub(crate) fn collapse(root: Option<&Binary<T>>, items: &[Item<T>], hidden: &dyn Fn(u32, u32) -> bool) -> Self {
        let mut wide = Self { nodes: Vec::new(), ids: [Vec::new(), Vec::new()], lo: [0.0; 3], hi: [0.0; 3] };
        if let Some(root) = root {
            wide.lo = root.bounds().lo.map(T::to_f64);
            wide.hi = root.bounds().hi.map(T::to_f64);
            wide.node(root, items, hidden);
            wide.nodes.shrink_to_fit();
        }
        wide
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

    /// Adds the node over `root`'s descendants; depth is bounded as the binary tree's is.
    fn node(&mut self, root: &Binary<T>, items: &[Item<T>], hidden: &dyn Fn(u32, u32) -> bool) -> u32 {
        let mut open: Vec<&Binary<T>> = Vec::with_capacity(WIDTH);
        match root {
            Binary::Inner { children, .. } => open.extend(children.iter()),
            Binary::Leaf { .. } => open.push(root),
        }
        while open.len() < WIDTH {
            let largest = open
                .iter()
                .enumerate()
                .filter(|(_, n)| matches!(n, Binary::Inner { .. }))
                .max_by(|(i, a), (j, b)| a.bounds().half_area().total_cmp(&b.bounds().half_area()).then(j.cmp(i)));
            let Some((at, Binary::Inner { children, .. })) = largest else { break };
            open[at] = &children[0];
            open.insert(at + 1, &children[1]);
        }
        let index = self.nodes.len();
        self.nodes.push(Node {
            lo: [[T::INFINITY; WIDTH]; 3],
            hi: [[T::NEG_INFINITY; WIDTH]; 3],
            child: [Child::NOTHING; WIDTH],
        });
        for (slot, child) in open.into_iter().enumerate() {
            let link = match child {
                Binary::Leaf { start, count, .. } => {
                    let items = &items[*start as usize..][..*count as usize];
                    let kind = items[0].kind;
                    let ids = &mut self.ids[usize::from(kind)];
                    let first = ids.len() as u32;
                    let matters = |i: &&Item<T>| !items.iter().any(|j| hidden(i.id, j.id));
                    ids.extend(items.iter().filter(matters).map(|i| i.id));
                    Child::leaf(kind, first, ids.len() as u32 - first)
                }
                Binary::Inner { .. } => Child(self.node(child, items, hidden)),
            };
            let Bounds { lo, hi } = *child.bounds();
            let node = &mut self.nodes[index];
            for k in 0..3 {
                node.lo[k][slot] = lo[k];
                node.hi[k][slot] = hi[k];
            }
            node.child[slot] = link;
        }
        index as u32
    }
}
