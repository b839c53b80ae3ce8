//! Numbers wide enough that a decision in them is the decision of real arithmetic.

mod ball;
mod big;
mod bound;
pub mod predicates;
mod quotient;
mod vector;
pub mod zero_area;

pub(crate) use ball::{Ball, Balls, Roots, Unsure};
pub use big::Big;
pub(crate) use bound::Bound;
pub use vector::Vector;
