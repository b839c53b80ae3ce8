//! What no scene can show: results that are well-formed and yet cannot be true.

use tessera_core::trace::RayCounts;

use crate::convert::Malformed;

/// Points that any sampling takes in one pixel, at most.
const POINTS: u64 = 1 << 20;

/// More light than any path of `max_depth` rays brings home from so many lights: at each of its points at most
/// all of each light, and in the end the background.
#[must_use]
pub fn brightest(lights: usize, max_depth: u32) -> f32 {
    // A little above, for the rounding of what is added up.
    ((lights as f64 * f64::from(max_depth) + 1.0) * 1.001).min(f64::from(f32::MAX)) as f32
}

/// Whether floats, red, green and blue in turn, may be light: none is negative, and none above `most`.
///
/// # Errors
/// When they may not.
pub fn check_light(floats: &[u8], most: f32) -> Result<(), Malformed> {
    let light = |b: &[u8; 4]| (0.0..=most).contains(&f32::from_le_bytes(*b));
    // Without an early end, so that the loop is a vector one.
    if floats.as_chunks::<4>().0.iter().fold(true, |all, b| all & light(b)) {
        Ok(())
    } else {
        Err(Malformed::Range("the light of a pixel"))
    }
}

/// Whether so many pixels can have taken so many rays, where each of a path's rays asks every light.
///
/// # Errors
/// When they cannot.
pub fn check_rays(rays: &RayCounts, pixels: u64, lights: usize, max_depth: u32) -> Result<(), Malformed> {
    let paths = pixels.saturating_mul(POINTS);
    let path = u64::from(max_depth).saturating_mul(lights as u64 + 1);
    let bounded = rays.camera <= paths && [rays.mirror, rays.shadow].iter().all(|&n| n <= paths.saturating_mul(path));
    if bounded && rays.unresolved <= paths { Ok(()) } else { Err(Malformed::Range("the number of rays")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_neither_negative_nor_more_than_there_is() {
        let check = |x: f32| check_light(&x.to_le_bytes(), brightest(2, 6));
        for good in [0.0, -0.0, 1.0, 13.0] {
            assert!(check(good).is_ok(), "{good}");
        }
        for bad in [-3e38, -1e-30, 14.0, 3e38, f32::NAN, f32::INFINITY] {
            assert!(check(bad).is_err(), "{bad}");
        }
        assert!(brightest(usize::MAX, u32::MAX).is_finite());
    }

    #[test]
    fn rays_are_those_that_pixels_can_take() {
        let rays = RayCounts { camera: 4096, mirror: 4096 * 5, shadow: 4096 * 12, ..RayCounts::default() };
        assert!(check_rays(&rays, 1, 2, 6).is_ok());
        assert!(check_rays(&RayCounts { camera: 1 << 48, ..rays }, 65_536, 2, 6).is_err());
        assert!(check_rays(&RayCounts { shadow: 1 << 48, ..rays }, 1, 2, 6).is_err());
        assert!(check_rays(&rays, u64::MAX, usize::MAX - 1, u32::MAX).is_ok());
    }
}
