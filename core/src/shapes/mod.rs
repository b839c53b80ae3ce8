//! What rays meet: each shape in a folder of its own, with all that is particular to it.
//!
//! Objects are near the camera's origin and at unit size, in f64, with tests that know their own error.
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
pub(crate) use bounds::coincide;
pub(crate) use interaction::{SurfaceInteraction, TAKEN, interaction, interaction_double};
pub(crate) use local::Local;
pub(crate) use object::{
    Decision, INSIDE, Kind, NONE, ObjectId, SPHERES, TRIANGLES, all_same, kind, surface_and_order,
};
pub(crate) use ray::{LEAST_SQUARE, Ray, Span};
pub(crate) use test::{test, test_double};
