//! Pixels made smaller for slow lines, without loss.
//!
//! Neighbours are alike in the upper bytes of their components. Each byte of a pixel goes to a plane of its own, as the
//! difference from the same byte of the pixel before, and the planes are deflated (RFC 1951).

use bytes::Bytes;
use miniz_oxide::deflate::compress_to_vec;
use miniz_oxide::inflate::decompress_to_vec_with_limit;

use crate::convert::Malformed;
use crate::limits::MAX_TILE_PIXELS;
use crate::pixels::PixelFormat;

/// Half a dozen times as quick as the usual one, for a few percent more bytes.
const LEVEL: u8 = 2;

/// Packs `pixels` of `bytes_per_pixel`; `None` where that makes them no smaller.
#[must_use]
pub fn pack(pixels: &[u8], bytes_per_pixel: usize) -> Option<Bytes> {
    let count = pixels.len() / bytes_per_pixel.max(1);
    let mut planes = Vec::with_capacity(pixels.len());
    for plane in 0..bytes_per_pixel {
        let mut before = 0;
        for pixel in pixels.chunks_exact(bytes_per_pixel) {
            planes.push(pixel[plane].wrapping_sub(before));
            before = pixel[plane];
        }
    }
    debug_assert_eq!(planes.len(), count * bytes_per_pixel, "pixels are whole");
    let packed = compress_to_vec(&planes, LEVEL);
    (packed.len() < pixels.len()).then(|| packed.into())
}

/// What [`pack`] was given.
///
/// # Errors
/// When these are no such bytes, or more pixels than a tile may have.
pub fn unpack(packed: &[u8], bytes_per_pixel: usize) -> Result<Bytes, Malformed> {
    if !PixelFormat::ALL.iter().any(|f| f.bytes_per_pixel() == bytes_per_pixel) {
        return Err(Malformed::Range("the form of packed pixels"));
    }
    let most = bytes_per_pixel * MAX_TILE_PIXELS as usize;
    let planes = decompress_to_vec_with_limit(packed, most).map_err(|_| Malformed::Range("packed pixels"))?;
    if !planes.len().is_multiple_of(bytes_per_pixel) {
        return Err(Malformed::Range("the number of pixels"));
    }
    let count = planes.len() / bytes_per_pixel;
    let mut pixels = vec![0; planes.len()];
    for (plane, differences) in planes.chunks_exact(count.max(1)).enumerate() {
        let mut before = 0u8;
        for (pixel, difference) in pixels.chunks_exact_mut(bytes_per_pixel).zip(differences) {
            before = before.wrapping_add(*difference);
            pixel[plane] = before;
        }
    }
    Ok(pixels.into())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn smooth_floats_shrink_and_come_back() {
        let light = |n: u32| (0.25 + 1e-4 * f64::from(n)) as f32;
        let pixels: Vec<u8> = (0..3 * 4096).flat_map(|n| light(n / 3).to_le_bytes()).collect();
        let packed = pack(&pixels, 12).unwrap();
        assert!(2 * packed.len() < pixels.len(), "{} of {}", packed.len(), pixels.len());
        assert_eq!(unpack(&packed, 12).unwrap(), pixels);
    }

    #[test]
    fn what_would_burst_is_refused() {
        let bomb = compress_to_vec(&vec![0; 13 * MAX_TILE_PIXELS as usize], 9);
        assert!(bomb.len() < 4096 && unpack(&bomb, 12).is_err());
        assert!(unpack(&bomb, 5).is_err() && unpack(&[], 3).is_err() && unpack(b"nonsense", 3).is_err());
    }

    proptest! {
        #[test]
        fn whatever_is_packed_comes_back(pixels in prop::collection::vec(any::<[u8; 6]>(), 1..200), smooth: bool) {
            let bytes: Vec<u8> = pixels.iter().flat_map(|p| if smooth { [p[0] / 64; 6] } else { *p }).collect();
            for bytes_per_pixel in [3, 6] {
                if let Some(packed) = pack(&bytes, bytes_per_pixel) {
                    prop_assert_eq!(unpack(&packed, bytes_per_pixel).unwrap(), bytes.clone());
                }
            }
        }

        #[test]
        fn nonsense_is_refused_or_small(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            for format in PixelFormat::ALL {
                if let Ok(pixels) = unpack(&bytes, format.bytes_per_pixel()) {
                    prop_assert!(pixels.len() <= 12 * MAX_TILE_PIXELS as usize);
                }
            }
        }
    }
}
