//! Numbers wide enough that a decision in them is the decision of real arithmetic.

mod big;
pub mod predicates;
mod vector;
pub mod zero_area;

pub use big::Big;
pub use vector::Vector;
