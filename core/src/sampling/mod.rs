//! Which rays a pixel asks for.

pub(crate) mod adaptive;
mod detail;
mod outline;
pub(crate) mod small;
