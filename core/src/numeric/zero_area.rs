//! Whether a triangle has exactly zero area.
//!
//! It has when the cross product of two of its sides is zero. A rounded evaluation with
//! a forward error bound answers for nearly every triangle, exact arithmetic for the rest.

use glam::DVec3;

use super::predicates::{Exact, cross_is_zero};

/// Whether the rounded cross product alone shows that the area is not zero.
#[must_use]
#[inline]
pub fn surely_not_zero(written: &[DVec3; 3], by_sides: bool) -> bool {
    let [a, b, c] = *written;
    let (u, v) = if by_sides { (b, c) } else { (b - a, c - a) };
    // Two differences and a product, each within 2^-53, then a difference: below 4 · 2^-53
    // of the products' magnitudes. What underflows is below the constant.
    let clear = |p: f64, q: f64| (p - q).abs() > 1e-15 * (p.abs() + q.abs()) + 1e-300;
    clear(u.y * v.z, u.z * v.y) || clear(u.z * v.x, u.x * v.z) || clear(u.x * v.y, u.y * v.x)
}

/// Whether the triangle with corners c0, c1, c2, or with corner c0 and sides v1, v2, has
/// exactly zero area. All numbers are finite.
#[must_use]
pub fn is_zero(written: &[DVec3; 3], by_sides: bool) -> bool {
    if surely_not_zero(written, by_sides) {
        return false;
    }
    let [a, b, c] = written.map(Exact::new);
    if by_sides { cross_is_zero(&b, &c) } else { cross_is_zero(&(b - a), &(c - a)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    #[test]
    fn is_decided_exactly() {
        let ulp = 1.0 + f64::EPSILON;
        // 0.1, 0.2, 0.3 as f64 are not evenly spaced.
        assert!(!is_zero(&[v(0.1, 0.1, 0.), v(0.2, 0.2, 0.), v(0.3, 0.30000000000000004, 0.)], false));
        for (points, by_sides, zero) in [
            ([v(0., 0., 0.), v(1., 1., 1.), v(3., 3., 3.)], false, true),
            ([v(0., 0., 0.), v(1., 1., 1.), v(3., 3., 3. * ulp)], false, false),
            ([v(1., 2., 3.); 3], false, true),
            ([v(1e300, 0., 0.), v(-1e300, 1e-300, 0.), v(0., 5e-301, 0.)], false, true),
            ([v(1e300, 0., 0.), v(-1e300, 1e-300, 0.), v(0., 5e-301 * ulp, 0.)], false, false),
            ([v(1e308, 1e308, 0.), v(-1e308, -1e308, 0.), v(0., 0., 0.)], false, true),
            ([v(1e308, 1e308, 0.), v(-1e308, -1e308, 0.), v(5e-324, 0., 0.)], false, false),
            ([v(9., 9., 9.), v(5e-324, 0., 0.), v(0., 5e-324, 0.)], true, false),
            ([v(9., 9., 9.), v(5e-324, 1e-323, 0.), v(1e-323, 2e-323, 0.)], true, true),
            ([v(9., 9., 9.), v(0., 0., 0.), v(1., 2., 3.)], true, true),
            ([v(9., 9., 9.), v(1e308, 3., -7.), v(-1e308, -3., 7.)], true, true),
            ([v(9., 9., 9.), v(1e308, 3., -7.), v(-1e308, -3., 7. * ulp)], true, false),
        ] {
            assert_eq!(is_zero(&points, by_sides), zero, "{points:?}");
        }
        // c0 may be far away: c0, c0 + v and c0 + 2v, all exact.
        assert!(is_zero(&[v(1e16, 0., 0.), v(1e16 + 2., 1., 0.), v(1e16 + 4., 2., 0.)], false));
        assert!(!is_zero(&[v(1e16, 0., 0.), v(1e16 + 2., 1., 0.), v(1e16 + 4., 2. * ulp, 0.)], false));
    }
}
