//! The objects of leaves, as one ray meets up to eight of them at once.

use rayon::prelude::*;

use crate::bvh::{Bvh, Coordinate, Link};
use crate::simd::{MOST, Rows, prefetch, roomy};

/// So many objects are put in rows in one go.
const PIECE: usize = 4096;

/// Objects of `N` numbers in the order leaves name them, the numbers of a leaf in rows: of all its
/// objects the first, then of all the second. A row is as long as the leaf has objects, so that
/// nothing is wasted; read as eight, it runs into the next.
#[derive(Debug)]
pub(crate) struct Leaves<const N: usize> {
    numbers: Vec<f32>,
}

impl<const N: usize> Leaves<N> {
    /// The objects of a kind in the hierarchy; `make` gives the numbers of one by its id.
    pub(super) fn new<T: Coordinate>(wide: &Bvh<T>, kind: u8, make: impl Fn(u32) -> [f32; N] + Sync) -> Self {
        let ids = &wide.ids[usize::from(kind)];
        // How many objects the leaf has that begins here.
        let mut counts = vec![0u8; ids.len()];
        for child in wide.nodes.iter().flat_map(|node| &node.child) {
            if let Link::Leaf { kind: k, start, count } = child.link()
                && k == kind
            {
                counts[start] = count as u8;
            }
        }
        // Behind the last there is room for a leaf to be read whole.
        let mut numbers = roomy((ids.len() + MOST) * N);
        numbers.par_extend(rayon::iter::repeat_n(0.0, (ids.len() + MOST) * N));
        let mut pieces = Vec::new();
        let (mut rest, mut from) = (&mut numbers[..], 0);
        while from < ids.len() {
            let end = (from + PIECE..ids.len()).find(|&i| counts[i] > 0).unwrap_or(ids.len());
            let (piece, behind) = rest.split_at_mut((end - from) * N);
            pieces.push((piece, from, end));
            (rest, from) = (behind, end);
        }
        pieces.into_par_iter().for_each(|(mut piece, mut from, end)| {
            while from < end {
                let count = usize::from(counts[from]);
                let (rows, behind) = piece.split_at_mut(count * N);
                for i in 0..count {
                    for (k, x) in make(ids[from + i]).into_iter().enumerate() {
                        rows[k * count + i] = x;
                    }
                }
                (piece, from) = (behind, from + count);
            }
        });
        Self { numbers }
    }

    #[inline(always)]
    pub(crate) fn leaf(&self, start: usize, count: usize) -> Rows<'_, N> {
        Rows::new(&self.numbers[start * N..], count)
    }

    /// Asks memory for a leaf.
    #[inline(always)]
    pub(crate) fn expect(&self, start: usize, count: usize) {
        prefetch(&self.numbers, start * N, count * N);
    }
}

/// The id of the `i`-th object of a leaf, which its last number stands for.
#[inline(always)]
pub(crate) fn id<const N: usize>(leaf: &Rows<'_, N>, i: usize) -> u32 {
    leaf.at(N - 1, i).tag()
}
