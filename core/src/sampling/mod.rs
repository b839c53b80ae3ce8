//! Which rays a pixel asks for.

pub(crate) mod adaptive;
mod block;
mod corners;
mod detail;
mod difference;
mod fit;
mod gaps;
pub(crate) mod lattice;
mod net;
mod points;
mod rounds;
mod shadow;
mod shape;
pub(crate) mod small;
mod strata;
mod tiers;
mod work;
