//! Which points a picture is sampled at, and how far it is off.

pub(crate) mod adaptive;
pub(crate) mod audit;
pub(crate) mod coarse;
mod composite;
pub(crate) mod coverage;
pub(crate) mod pixel;
pub(crate) mod points;
pub(crate) mod proof;
mod shadows;
mod sheet;
