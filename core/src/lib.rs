//! The shared heart of the farm: text to scene, scene to pixels.
//!
//! Data walks one way through the rooms: [`xml`] (text, checked and positioned)
//! → [`scene`] (resolved and immutable) → `shapes` and `bvh` (what rays meet)
//! → [`trace`] (radiance along a ray) → [`sampling`] (which rays) → `render`
//! (tiles) → [`film`] (pictures, files). `xml` and `trace` do not know each other.
//!
//! This crate does no networking, reads no clock, spawns no async task and
//! prints nothing.

mod beam;
mod bvh;
pub mod film;
pub mod numeric;
mod render;
pub mod sampling;
pub mod scene;
pub mod settings;
mod shapes;
pub mod simd;
pub mod text;
pub mod trace;
pub mod xml;
