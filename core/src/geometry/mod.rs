//! What rays meet: the scene's objects near the camera's origin and at unit size, in f64,
//! with tests that know their own error.
//!
//! **Local space.** Coordinates here are (world − camera location) · 2^−k, k such that the
//! largest finite object reaches about 1. Both steps are exact or lose at most half a unit
//! in the last place, so a scene and its copy scaled by a power of two, or moved by an exact
//! offset, are the same numbers here.
//!
//! **Bounds.** A [`Ray`] says how far it may be from the ray of real arithmetic. Each
//! `test` function returns a [`Span`] that surely contains the real distance, and says
//! whether the hit itself is sure. What is not sure is decided elsewhere
//! (`trace::exact`), never by a tolerance.

pub(crate) mod aabb;
mod double_double;
pub(crate) mod giant;
pub(crate) mod plane;
pub(crate) mod ray;
pub(crate) mod real;
pub(crate) mod sphere;
pub(crate) mod triangle;

pub(crate) use aabb::Aabb;
pub(crate) use double_double::DoubleDouble;
pub(crate) use ray::{LEAST_SQUARE, Ray, Span};
pub(crate) use real::{Real, Scalar, V3};

/// The unit roundoff of f64, 2⁻⁵³.
pub(crate) const U: f64 = f64::EPSILON / 2.0;

/// Added to every absolute bound: covers all underflow in a kernel, since after scaling
/// nothing that matters is near the smallest numbers.
pub(crate) const TINY: f64 = 1e-290;
