//! What rays meet: each shape in a folder of its own, with all that is particular to it.
//!
//! A file of a shape's folder is one facet of it: `bounds` and `local` (where it is), `filter` (before packets of f32),
//! `mod` (before a ray over any `Real`), `giant` (the same around the eye), `exact` and `proof` (before a ray in wide
//! numbers), `interaction` (where it is met), `texture`, `coplanar` (exact planes) and `beam` (before all points of a
//! pixel). The file of the same name beside the folders has what shapes have in common there, and tells them apart:
//! whoever traces asks it with an [`ObjectId`]. Only where many rays or lanes
//! are dealt with by shape, whoever does that knows them: packets (`traverse`) and waves (`integrate`).
//!
//! **Numbering.** Planes have the least ids, then spheres, then triangles, see `object`.
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
pub(crate) use interaction::{SurfaceInteraction, TAKEN, interaction_double};
pub(crate) use local::Local;
pub(crate) use object::{
    Decision, INSIDE, Kind, NONE, ObjectId, SPHERES, TRIANGLES, all_same, first_sphere, first_triangle, kind,
    surface_and_order,
};
pub(crate) use ray::{LEAST_SQUARE, Ray, Span};
pub(crate) use test::{test, test_double};
