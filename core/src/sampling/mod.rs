//! Which rays a pixel asks for.

pub(crate) mod adaptive;
mod block;
mod cells;
mod corners;
mod cuts;
mod detail;
mod difference;
mod estimate;
mod fit;
mod gaps;
pub(crate) mod lattice;
mod rounds;
mod shadow;
mod shape;
pub(crate) mod small;
mod strata;
mod work;
