//! What a colour number means: sRGB-encoded (IEC 61966-2-1) or linear.
//!
//! The powers are `libm`'s, so that a scene's colours are the same bits on every machine.

use crate::settings::Transfer;

/// A colour number in [0, 1] as linear radiance.
#[must_use]
pub fn to_linear(transfer: Transfer, code: f64) -> f64 {
    match transfer {
        Transfer::Linear => code,
        Transfer::Srgb if code <= 0.04045 => code / 12.92,
        Transfer::Srgb => libm::pow((code + 0.055) / 1.055, 2.4),
    }
}

/// Linear radiance in [0, 1] as a colour number.
#[must_use]
pub fn from_linear(transfer: Transfer, linear: f64) -> f64 {
    match transfer {
        Transfer::Linear => linear,
        Transfer::Srgb if linear <= 0.0031308 => linear * 12.92,
        Transfer::Srgb => 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055,
    }
}

/// The linear radiance of every sample 0 to `maxval` of a picture: entry s is that of s/maxval.
#[must_use]
pub fn table(transfer: Transfer, maxval: u16) -> Vec<f64> {
    (0..=maxval).map(|s| to_linear(transfer, f64::from(s) / f64::from(maxval))).collect()
}
