//! What rays meet: each shape in a folder of its own, with all that is particular to it.
//!
//! A file of a shape's folder is one facet of it: `mod` and `local` (in local space, before a ray over any `Real`, and
//! where it is met), `giant` (the same around the eye), `bounds` (where it is), `filter` (before packets of f32),
//! `exact` and `proof` (before a ray in wide numbers), `texture`, `coplanar` (exact planes) and `beam` (before all
//! points of a pixel). The file of the same name beside the folders (of `mod`, it is `test`) has what shapes have in common there,
//! and the trait that each of them implements: whoever traces asks it with an [`ObjectId`]. Which shapes there are
//! stands in `list` alone, whose macros are for whoever deals with many rays or lanes shape by shape.
//!
//! **Numbering.** Objects have ids shape by shape, in the order of the list.
//!
//! **Local space.** Coordinates here are (world − camera location) · 2^−k, k such that the
//! largest finite object reaches about 1. Both steps are exact or lose at most half a unit
//! in the last place, so a scene and its copy scaled by a power of two, or moved by an exact
//! offset, are the same numbers here.
//!
//! **Bounds.** A [`Ray`] says how far it may be from the ray of real arithmetic. Each
//! `test` function returns a [`Span`] that surely contains the real distance, and says
//! whether the hit itself is sure. What is not sure is decided elsewhere
//! (`exact`), never by a tolerance.

mod aabb;
pub(crate) mod beam;
mod bounds;
pub(crate) mod coplanar;
pub(crate) mod exact;
pub(crate) mod filter;
pub(crate) mod giants;
pub(crate) mod integers;
mod interaction;
pub(crate) mod leaves;
mod list;
pub(crate) mod local;
mod object;
pub(crate) mod plane;
pub(crate) mod proof;
mod ray;
pub(crate) mod sphere;
mod test;
pub(crate) mod texture;
pub(crate) mod triangle;

pub(crate) use aabb::Aabb;
pub(crate) use bounds::{bounds, coincide};
pub(crate) use interaction::{SurfaceInteraction, TAKEN};
pub(crate) use list::{Columns, Giants, Kind, Listed, SHAPES, column, each_shape, firsts, kind, leaf_ends, of_shape};
pub(crate) use local::Local;
pub(crate) use object::{Decision, INSIDE, NONE, ObjectId, all_same, surface_and_order};
pub(crate) use ray::{LEAST_SQUARE, Ray, Span};
pub(crate) use test::{Shape, interaction_double, test, test_double};
