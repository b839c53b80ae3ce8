//! Whole pictures as files hold them.

use sha2::{Digest, Sha256};

/// The pixels of a picture as a file stores or is to store them, rows from the top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelsRef<'a> {
    /// 8-bit codes.
    Rgb8(&'a [[u8; 3]]),
    /// 16-bit codes.
    Rgb16(&'a [[u16; 3]]),
    /// Linear radiance, unclamped.
    F32(&'a [[f32; 3]]),
}

impl PixelsRef<'_> {
    /// Those of `range`; `None` where there are no such pixels.
    #[must_use]
    pub fn get(self, range: std::ops::Range<usize>) -> Option<Self> {
        Some(match self {
            Self::Rgb8(p) => Self::Rgb8(p.get(range)?),
            Self::Rgb16(p) => Self::Rgb16(p.get(range)?),
            Self::F32(p) => Self::F32(p.get(range)?),
        })
    }

    /// How many pixels there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Rgb8(p) => p.len(),
            Self::Rgb16(p) => p.len(),
            Self::F32(p) => p.len(),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A picture of f32 components, rows from the top, at least one pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 3]>,
}

impl Image {
    /// The picture, or `None` where it would be empty or `pixels` are not `width` × `height`.
    #[must_use]
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Option<Self> {
        let count = (width as usize).checked_mul(height as usize)?;
        (count > 0 && pixels.len() == count).then_some(Self { width, height, pixels })
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, rows from the top.
    #[must_use]
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// Every component put through `f`.
    #[must_use]
    pub fn map(mut self, f: impl Fn(f32) -> f32) -> Self {
        self.pixels.as_flattened_mut().iter_mut().for_each(|x| *x = f(*x));
        self
    }
}

/// SHA-256 of linear pixels as little-endian f32, red, green, blue, rows from the top, in hexadecimal.
#[must_use]
pub fn pixels_sha256(pixels: &[[f32; 3]]) -> String {
    let mut hash = Sha256::new();
    let mut bytes = Vec::with_capacity(12 * pixels.len().min(1 << 12));
    for block in pixels.chunks(1 << 12) {
        bytes.clear();
        bytes.extend(block.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        hash.update(&bytes);
    }
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_little_endian_floats() {
        // printf '\0\0\x80\x3f\0\0\0\x3f\0\0\0\0' | sha256sum
        assert_eq!(
            pixels_sha256(&[[1.0, 0.5, 0.0]]),
            "be115d3ffbb025877d7320bd3b0b29cbe245f520f805091917a60169e7737659"
        );
    }
}
