//! The farm's wire protocol: `farm.proto`, and the one place where its messages
//! become core types and back.

mod pixels;

pub use pixels::{PixelFormat, Pixels};
