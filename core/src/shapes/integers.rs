//! A scene's numbers as integers, all times one power of two: for proofs of what is zero.

use glam::DVec3;

use super::exact::Exact;
use super::{Listed, ObjectId, of_shape};
use crate::numeric::Balls;
use crate::scene::Scene;

/// The exponent of the lowest bit that is set; `None` for zero.
fn lowest_bit(x: f64) -> Option<i64> {
    let bits = x.to_bits();
    let (biased, fraction) = (((bits >> 52) & 0x7ff) as i64, bits & ((1 << 52) - 1));
    let (mantissa, power) = if biased == 0 { (fraction, -1074) } else { (fraction | 1 << 52, biased - 1075) };
    (mantissa != 0).then(|| power + i64::from(mantissa.trailing_zeros()))
}

/// k such that all of `numbers` times 2^k are integers, and no less than that takes.
pub(crate) fn to_integers(numbers: impl IntoIterator<Item = f64>) -> i64 {
    -numbers.into_iter().filter_map(lowest_bit).min().unwrap_or(0)
}

/// `v` times a power of two, as integers.
pub(crate) fn direction<const N: usize>(v: DVec3) -> Balls<N> {
    Balls::scaled(v, to_integers(v.to_array()))
}

/// The lengths of object `id`.
pub(crate) fn lengths(scene: &Scene, id: ObjectId) -> impl Iterator<Item = f64> {
    let (vectors, x) = of_shape!(scene, id, O, i => O::all(scene)[i].lengths());
    vectors.into_iter().flat_map(|v| v.to_array()).chain([x])
}
