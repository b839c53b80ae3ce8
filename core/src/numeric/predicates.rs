//! Exact yes-or-no questions about f64 vectors.

use glam::DVec3;

use super::{Big, Vector};

/// Wide enough that products of differences of any two f64 are exact: differences span at
/// most 2098 bits, a product of one with an f64 2151, the difference of two such 4 300.
pub(crate) type Exact = Vector<68>;

pub(crate) fn cross_is_zero(a: &Exact, b: &Exact) -> bool {
    let p = |i: usize, j: usize| -> Big<68> { a.0[i] * b.0[j] };
    p(1, 2) == p(2, 1) && p(2, 0) == p(0, 2) && p(0, 1) == p(1, 0)
}

/// Whether `a` and `b`, both not zero, are exactly parallel or antiparallel.
#[must_use]
pub fn parallel(a: DVec3, b: DVec3) -> bool {
    cross_is_zero(&Exact::new(a), &Exact::new(b))
}

/// Whether `sky` is exactly parallel to `look_at` − `location`, that difference taken exactly.
#[must_use]
pub fn parallel_to_view(location: DVec3, look_at: DVec3, sky: DVec3) -> bool {
    cross_is_zero(&(Exact::new(look_at) - Exact::new(location)), &Exact::new(sky))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_is_decided_exactly_at_any_scale() {
        let v = DVec3::new(1.0, 3.0, -7.0);
        assert!(parallel(v, v * -(2f64.powi(900))));
        assert!(parallel(v, v * 2f64.powi(-900)));
        assert!(!parallel(v, DVec3::new(1.0, 3.0, -7.0f64.next_up())));
        // 1e-320 beside 1: the cross product underflows in f64 and is not zero.
        assert!(!parallel(DVec3::new(1.0, 1e-320, 0.0), DVec3::X));
        assert!(!parallel(DVec3::new(1e-200, 1e-200, 0.0), DVec3::new(1e-200, 1.1e-200, 0.0)));
    }

    #[test]
    fn the_view_is_subtracted_exactly() {
        let location = DVec3::new(1e300, 0.0, 0.0);
        let look_at = DVec3::new(0.0, 1e-300, 0.0);
        assert!(!parallel_to_view(location, look_at, DVec3::X));
        assert!(parallel_to_view(DVec3::X, DVec3::X + DVec3::Y, DVec3::Y * 1e-310));
    }
}
