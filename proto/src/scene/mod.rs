//! The scene's compact binary form, as `farm.proto` lays it down: written and
//! read piece by piece, so that neither side ever holds it whole.

mod decode;
mod encode;
#[cfg(test)]
mod tests;

pub use decode::{SceneDecoder, SceneError};
pub use encode::{SceneEncoder, describe, describe_parts};

const MAGIC: &[u8; 8] = b"TSRSCN01";

const PLANE_POINT: u8 = 1;
const PLANE_DISTANCE: u8 = 2;
const SPHERE: u8 = 3;
const SPHERE_ORIENTED: u8 = 4;
const TRIANGLE_CORNERS: u8 = 5;
const TRIANGLE_SIDES: u8 = 6;

/// Bytes of one object of `kind`, or `None` where there is no such kind.
fn object_bytes(kind: u8) -> Option<usize> {
    Some(match kind {
        PLANE_POINT => 48,
        PLANE_DISTANCE | SPHERE => 32,
        SPHERE_ORIENTED => 80,
        TRIANGLE_CORNERS | TRIANGLE_SIDES => 72,
        _ => return None,
    })
}
