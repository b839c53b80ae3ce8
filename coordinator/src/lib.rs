//! Reads a scene, hands tiles to workers, stitches the picture.

pub mod povray;
