//! Which rays a pixel asks for.

pub(crate) mod adaptive;
mod block;
mod cell;
mod corners;
mod curve;
mod detail;
mod feature;
mod outline;
mod part;
mod shadow;
mod side;
pub(crate) mod small;
pub(crate) mod store;
