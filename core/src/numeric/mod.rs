//! Numbers: wide enough that a decision in them is the decision of real arithmetic, or fast and with bounds on what
//! they may be wrong by. Nothing here knows of scenes.

mod ball;
mod big;
mod bound;
mod double_double;
pub mod predicates;
mod quotient;
mod real;
mod residue;
mod vector;
pub mod zero_area;

pub(crate) use ball::{Ball, Balls, Roots, Unsure};
pub use big::Big;
pub(crate) use bound::Bound;
pub(crate) use double_double::DoubleDouble;
pub(crate) use real::{Real, Scalar, V3};
pub(crate) use residue::Residue;
pub use vector::Vector;

/// The unit roundoff of f64, 2⁻⁵³.
pub(crate) const U: f64 = f64::EPSILON / 2.0;

/// Added to every absolute bound: covers all underflow in a kernel, since after scaling
/// nothing that matters is near the smallest numbers.
pub(crate) const TINY: f64 = 1e-290;
