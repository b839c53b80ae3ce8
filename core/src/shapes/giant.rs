//! What describes objects around the eye that are far larger than what is seen of them: found in wide numbers, and
//! rounded once.

use glam::DVec3;

use crate::numeric::{Big, V3, Vector};

/// Limbs in which they are found.
pub(super) const WIDE: usize = 24;
/// What is this many bits below its terms may be nothing.
pub(super) const LOST: i64 = 1000;

/// `x` to the nearest f64, `None` where its digits may be lost beside `terms` or it is beyond f64's normal numbers.
pub(super) fn known(x: &Big<WIDE>, terms: i64) -> Option<f64> {
    if x.is_zero() || x.exponent() < terms - LOST {
        return None;
    }
    let rounded = x.to_f64();
    (rounded.is_finite() && rounded.abs() > 1e-200).then_some(rounded)
}

/// The components of `v`, of which those next to nothing become 0.
pub(super) fn vector(v: &Vector<WIDE>) -> V3<f64> {
    let all = v.to_f64();
    let least = 1e-250 * all.abs().max_element();
    V3::splat(DVec3::from_array(all.to_array().map(|x| if x.abs() < least { 0.0 } else { x })))
}
