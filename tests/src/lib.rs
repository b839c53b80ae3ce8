//! What the tests are made of: scenes, oracles and comparisons.
//!
//! The oracles share no code with the tracer: [`mod@reference`] is the image model in
//! plain f64, written to be read; [`oracle`] is the same model in 512-bit arithmetic
//! whose every decision is proven or counted as a tie; [`exact`] answers questions
//! about a single ray and object in exact arithmetic.

pub mod callgrind;
pub mod cluster;
pub mod compare;
pub mod costs;
pub mod edges;
#[cfg(unix)]
pub mod engine;
pub mod exact;
pub mod fake;
pub mod fuzz;
pub mod generate;
pub mod golden;
pub mod hostile;
pub mod journal;
pub mod judge;
pub mod loopback;
pub mod network;
pub mod oracle;
pub mod peers;
pub mod pigment;
pub mod process;
pub mod program;
pub mod proxy;
pub mod reference;
pub mod renderers;
pub mod subject;
pub mod truth;
pub mod wait;
pub mod web;
