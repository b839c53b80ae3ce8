//! Scenes made by program: as documents to be read, and resolved.

pub mod cliff;
pub mod contact;
mod document;
pub mod event;
pub mod extreme;
pub mod fine;
mod mesh;
mod ply;
mod random;
mod scenes;

pub use document::{Document, Item, Look, Paint, Placement};
pub use mesh::{Mesh, icosphere, knot, torus};
pub use ply::{read_ply, scans};
pub use random::Random;
pub use scenes::{demo, globe, knot_scene, lights, mesh_scene, mirrors, sphereflake, terrain};
