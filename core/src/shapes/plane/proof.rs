//! A plane before a line in numbers that prove what is zero.

use crate::numeric::{Ball, Balls, Roots, Unsure};
use crate::scene::{Plane, PlanePosition};
use crate::shapes::integers::direction;
use crate::shapes::proof::{Along, Flat, Line};

/// The plane before `line`; lengths times 2^scale are integers.
pub(crate) fn flat<const N: usize>(line: &Line<N>, plane: &Plane, scale: i64, roots: &mut Roots) -> Flat<N> {
    let Line { x, w, d, .. } = *line;
    let n = direction(plane.normal);
    let offset = match plane.position {
        PlanePosition::Point(q) => n.dot(&Balls::scaled(q, scale)),
        PlanePosition::Distance(h) => Ball::scaled(h, scale) * n.dot(&n).sqrt(roots),
    };
    Flat { n, num: offset * w - n.dot(&x), den: n.dot(&d) }
}

/// Where `line`, which starts elsewhere, meets the plane.
pub(crate) fn intersect<const N: usize>(
    line: &Line<N>,
    plane: &Plane,
    scale: i64,
    roots: &mut Roots,
) -> Result<Option<(Along<N>, bool)>, Unsure> {
    flat(line, plane, scale, roots).intersect([Ok(0); 3])
}
