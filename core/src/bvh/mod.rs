//! A bounding volume hierarchy, eight boxes a node.
//!
//! Boxes are stored as f32, rounded outward, where that hardly enlarges them, and as f64
//! elsewhere ([`Boxes`]); either way a box surely contains what is below it, rounding of
//! local space included. Built by binned SAH (Wald, *On fast construction of SAH-based
//! bounding volume hierarchies*, RT 2007), eight children a node by opening the largest
//! (Wald, Benthin, Boulos, *Getting rid of packets*, RT 2008). The result is the
//! same for any number of threads.

mod build;
mod coordinate;
mod split;
mod tree;

pub(crate) use build::Builder;
pub(crate) use coordinate::Coordinate;
pub(crate) use split::Item;
pub(crate) use tree::{Bvh, Child, KINDS, Link, Node, WIDTH};

/// The hierarchy, in the narrowest coordinates that serve the scene.
#[derive(Debug)]
pub(crate) enum Boxes {
    /// Boxes rounded outward to f32.
    F32(Bvh<f32>),
    /// Boxes in f64, where outward rounding to f32 would enlarge them noticeably.
    F64(Bvh<f64>),
}
