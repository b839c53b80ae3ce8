//! Which rays a pixel asks for.

pub(crate) mod adaptive;
mod block;
mod corners;
mod detail;
mod difference;
mod fit;
pub(crate) mod lattice;
mod net;
mod rounds;
mod shadow;
mod shape;
pub(crate) mod small;
mod strata;
mod work;
