//! Whether a triangle has exactly zero area.
//!
//! It has when the cross product of two of its sides is zero: three sums of products
//! of coordinates. A rounded evaluation with a forward error bound answers for nearly
//! every triangle; the rest are summed in fixed point over f64's whole range.

use glam::DVec3;

/// Limbs of 64 bits: products go from 2^-2148 to below 2^2048, sums a little further.
const LIMBS: usize = 67;
/// The exponent of an accumulator's lowest bit.
const LOWEST: i32 = -2148;

/// An exact sum of products of two f64s each, in two's complement.
struct Sum([u64; LIMBS]);

/// A finite f64 as ±mantissa · 2^exponent.
fn split(x: f64) -> (u64, i32) {
    let bits = x.to_bits();
    let (exponent, fraction) = ((bits >> 52) & 0x7FF, bits & ((1 << 52) - 1));
    if exponent == 0 { (fraction, -1074) } else { (fraction | 1 << 52, exponent as i32 - 1075) }
}

impl Sum {
    fn add(&mut self, a: f64, b: f64, minus: bool) {
        let ((ma, ea), (mb, eb)) = (split(a), split(b));
        let product = u128::from(ma) * u128::from(mb);
        let shift = (ea + eb - LOWEST) as usize; // both exponents are at least -1074
        let (limb, bit) = (shift / 64, shift % 64);
        // 106 bits shifted by up to 63 span three limbs.
        let low = product << bit;
        let high = if bit == 0 { 0 } else { product >> (128 - bit) };
        let parts = [low as u64, (low >> 64) as u64, high as u64];
        let negative = a.is_sign_negative() != b.is_sign_negative();
        let mut carry = false;
        for (i, to) in self.0[limb..].iter_mut().enumerate() {
            let part = parts.get(i).copied().unwrap_or(0);
            let (sum, over) = if negative != minus { to.overflowing_sub(part) } else { to.overflowing_add(part) };
            let (sum, over2) =
                if negative != minus { sum.overflowing_sub(carry.into()) } else { sum.overflowing_add(carry.into()) };
            *to = sum;
            carry = over || over2;
            if i >= parts.len() && !carry {
                break;
            }
        }
    }
    fn is_zero(&self) -> bool {
        self.0.iter().all(|&l| l == 0)
    }
}

/// Whether the components u and v of three points lie on one line.
fn collinear(a: (f64, f64), b: (f64, f64), c: (f64, f64)) -> bool {
    // (b − a) × (c − a), multiplied out; a × a is nothing.
    let mut sum = Sum([0; LIMBS]);
    for (p, q) in [(b, c), (c, a), (a, b)] {
        sum.add(p.0, q.1, false);
        sum.add(p.1, q.0, true);
    }
    sum.is_zero()
}

/// Whether two sides in the components u and v are parallel, or one is zero.
fn parallel(a: (f64, f64), b: (f64, f64)) -> bool {
    let mut sum = Sum([0; LIMBS]);
    sum.add(a.0, b.1, false);
    sum.add(a.1, b.0, true);
    sum.is_zero()
}

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
    let flat = |project: fn(DVec3) -> (f64, f64)| {
        let [a, b, c] = written.map(project);
        if by_sides { parallel(b, c) } else { collinear(a, b, c) }
    };
    flat(|p| (p.x, p.y)) && flat(|p| (p.y, p.z)) && flat(|p| (p.z, p.x))
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
            ([v(1e300, 0., 0.), v(-1e300, 1e-300, 0.), v(0., 5e-301, 0.)], false, false),
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
