//! A plane beside others in exact arithmetic.

use super::LocalPlane;
use crate::numeric::{Ball, Balls, Residue, V3};
use crate::scene::{Plane, PlanePosition};
use crate::shapes::coplanar::{IntegerPlane, Offset, dot, residue};
use crate::shapes::integers::direction;

/// Which axis it is square to, and where it crosses that.
pub(crate) fn square_to_axis(plane: &Plane) -> Option<(usize, f64)> {
    let n = plane.normal;
    let axis = (0..3).find(|&k| (0..3).all(|j| (n[j] == 0.0) == (j != k)))?;
    let at = match plane.position {
        PlanePosition::Point(q) => q[axis],
        PlanePosition::Distance(d) => {
            if n[axis] < 0.0 {
                -d
            } else {
                d
            }
        }
    };
    Some((axis, at))
}

/// The normal, and the square of the offset.
pub(crate) fn residues(plane: &Plane) -> ([Residue; 3], Residue) {
    let n = residue(plane.normal);
    match plane.position {
        PlanePosition::Point(q) => (n, dot(n, residue(q)) * dot(n, residue(q))),
        PlanePosition::Distance(d) => (n, Residue::of(d) * Residue::of(d) * dot(n, n)),
    }
}

/// The distance of `p`, and the size of what it is the sum of.
pub(crate) fn distance(plane: &LocalPlane, p: V3<f64>) -> (f64, f64) {
    (plane.n.dot(p) - plane.h, p.norm1() + plane.h.abs())
}

/// The plane in integers; lengths times 2^scale are some.
pub(crate) fn in_integers<const N: usize>(plane: &Plane, scale: i64) -> IntegerPlane<N> {
    let n = direction(plane.normal);
    let offset = match plane.position {
        PlanePosition::Point(q) => Offset::Rational(n.dot(&Balls::scaled(q, scale))),
        PlanePosition::Distance(d) => {
            let far = Ball::scaled(d, scale);
            Offset::Root(far.mid().signum(), far * far * n.dot(&n))
        }
    };
    IntegerPlane { n, offset }
}
