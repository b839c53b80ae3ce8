//! What rays meet first, and whether anything is in their way: in packets of f32, which pass on what they cannot tell
//! apart, and one by one in f64. Neither guesses: what f64 leaves open is a question to `exact`.

mod condition;
mod coplanar;
pub(crate) mod filter;
pub(crate) mod packet;
mod prepared;
mod scalar;

pub use condition::Condition;
pub use coplanar::SharedPlanes;
pub use prepared::PreparedScene;
pub(crate) use scalar::{Closest, Occluded, Scratch};
