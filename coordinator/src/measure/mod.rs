//! What a second buys: a scene rendered at many settings, each held against a reference.
//!
//! ```text
//! one quick render ─▶ reference (or a file) ─▶ every setting, the cheapest first ─▶ peers
//!                                                 └─ seconds, rays, errors ─▶ Pareto front, recommendation
//!                                                                              ─▶ table, CSV, JSON, plot
//! ```
//! Every picture is rendered as a user's would be: by workers of this process, over gRPC. Only
//! [`measure`] and the peers' runs read the clock; what follows from the figures is pure.

mod bench;
mod knob;
mod pareto;
mod peer;
mod plot;
mod point;
mod record;
mod reference;
mod run;
mod sweep;
mod table;
mod trial;

pub use knob::{Knob, Method};
pub use peer::{PeerError, installed as povray_installed};
pub use plot::Plot;
pub use point::{Measured, Point, Predicted, Rays, Recommendation, Skipped};
pub use reference::{Reference, ReferenceError, Source};
pub use run::{MeasureError, Order, Stage, measure};
