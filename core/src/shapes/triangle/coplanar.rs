//! A triangle's plane beside others in exact arithmetic.

use super::LocalTriangle;
use crate::numeric::{Balls, Residue, V3};
use crate::scene::Triangle;
use crate::shapes::coplanar::{IntegerPlane, Offset, dot, residue};

/// Which axis its plane is square to, and where it crosses that.
pub(crate) fn square_to_axis(t: &Triangle) -> Option<(usize, f64)> {
    let [a, b, c] = t.written;
    let level = |k: usize| if t.by_sides() { b[k] == 0.0 && c[k] == 0.0 } else { a[k] == b[k] && a[k] == c[k] };
    let axis = (0..3).find(|&k| level(k))?;
    Some((axis, a[axis]))
}

/// The normal, and the square of the offset.
pub(crate) fn residues(t: &Triangle) -> ([Residue; 3], Residue) {
    let [a, b, c] = t.written.map(residue);
    let side = |v: [Residue; 3]| if t.by_sides() { v } else { [0, 1, 2].map(|k| v[k] - a[k]) };
    let (u, v) = (side(b), side(c));
    let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    (n, dot(n, a) * dot(n, a))
}

/// The distance of `p` from its plane times the normal, and the size of what that is the sum of.
pub(crate) fn distance(t: &LocalTriangle, p: V3<f64>) -> (f64, f64) {
    let [a, b, c] = t.v;
    let reach = a.norm1() + b.norm1() + c.norm1() + p.norm1();
    let (u, v) = (b - a, c - a);
    (u.cross(v).dot(p - a), (u.norm1() + v.norm1()) * (u.norm1() + v.norm1() + reach) * reach)
}

/// Its plane in integers; lengths times 2^scale are some.
pub(crate) fn in_integers<const N: usize>(t: &Triangle, scale: i64) -> IntegerPlane<N> {
    let [a, b, c] = t.written.map(|v| Balls::scaled(v, scale));
    let n = if t.by_sides() { b.cross(&c) } else { (b - a).cross(&(c - a)) };
    IntegerPlane { n, offset: Offset::Rational(n.dot(&a)) }
}
