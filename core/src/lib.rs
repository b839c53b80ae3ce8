//! The shared heart of the farm: text to scene, scene to pixels.
//!
//! Data walks one way through the rooms: [`xml`] (text, checked and positioned)
//! → [`scene`] (resolved and immutable) → `shapes` and `bvh` (what rays meet)
//! → `traverse` and `exact` (what they meet first) → `integrate` (radiance along a
//! ray) → [`sampling`] (which rays) → `render` (tiles) → [`film`] (pictures, files).
//!
//! This crate does no networking, reads no clock, spawns no async task and
//! prints nothing.

mod beam;
mod bvh;
mod exact;
pub mod film;
mod integrate;
pub mod numeric;
mod render;
pub mod sampling;
pub mod scene;
pub mod settings;
mod shapes;
pub mod simd;
pub mod text;
mod traverse;
pub mod xml;

/// Radiance along rays, as other crates ask for it: [`PreparedScene`](trace::PreparedScene) and
/// [`Tracer`](trace::Tracer).
pub mod trace {
    pub use crate::exact::RayHit;
    pub use crate::film::PlanePoint;
    pub use crate::integrate::{PrepareError, RayCounts, Refinement, Tracer};
    pub use crate::traverse::{Condition, PreparedScene, SharedPlanes};
}
