//! The image model by brute force in 512 bits or more, every decision proven.
//!
//! Numbers are [`Ball`]s: a decision that a ball's error leaves open is a tie, that is,
//! counts as equality, for scenes are written in f64 and what differs by less than
//! 2^-400 of its terms differs by nothing. Objects are closed sets: an edge, a vertex,
//! a tangent point belong to them. Of equally near objects the first in the document
//! is seen.

mod ball;
mod object;
mod render;

pub use ball::{Ball, Vector};
pub use object::{Hit, Object};
pub use render::{Oracle, Picture};
