//! Numbers wide enough that a decision in them is the decision of real arithmetic.
pub mod predicates;
pub mod zero_area;
