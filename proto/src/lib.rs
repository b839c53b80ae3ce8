//! The farm's wire protocol: `farm.proto`, and the one place where its messages
//! become core types and back.
//!
//! `farm.proto`'s comments are the specification. [`wire`] is what is generated
//! from it; [`convert`] checks what arrives; [`scene`] is the scene's binary form.

pub mod convert;
pub mod credential;
pub mod identity;
mod ids;
mod layers;
pub mod limits;
pub mod packed;
mod pixels;
pub mod plausible;
pub mod scene;
pub mod token;
mod trace_context;

pub use ids::{Attempt, InstanceId, JobNumber, LeaseId, PassNumber, SceneHash, SessionId};
pub use layers::layers_at;
pub use pixels::{PixelFormat, Pixels};
pub use trace_context::TraceContext;

/// What is generated from `farm.proto`, documented there.
#[allow(missing_docs, unreachable_pub, clippy::all, reason = "generated; farm.proto is its documentation")]
pub mod wire {
    tonic::include_proto!("tessera.farm.v1");
}

/// What is generated from `journal.proto`, documented there.
#[allow(missing_docs, unreachable_pub, clippy::all, reason = "generated; journal.proto is its documentation")]
pub mod journal {
    include!(concat!(env!("OUT_DIR"), "/journal/tessera.journal.v1.rs"));
}

/// What is generated from `control.proto`, documented there.
#[allow(missing_docs, unreachable_pub, clippy::all, reason = "generated; control.proto is its documentation")]
pub mod control {
    include!(concat!(env!("OUT_DIR"), "/control/tessera.control.v1.rs"));
}
