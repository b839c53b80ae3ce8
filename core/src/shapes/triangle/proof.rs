//! A triangle before a line in numbers that prove what is zero.

use crate::numeric::{Balls, Unsure};
use crate::scene::Triangle;
use crate::shapes::proof::{Along, Flat, Line};

/// The first corner and the sides; lengths times 2^scale are integers.
fn corner_and_sides<const N: usize>(t: &Triangle, scale: i64) -> [Balls<N>; 3] {
    let [a, b, c] = t.written.map(|v| Balls::scaled(v, scale));
    if t.by_sides() { [a, b, c] } else { [a, b - a, c - a] }
}

fn plane_of<const N: usize>(line: &Line<N>, [a, e1, e2]: &[Balls<N>; 3]) -> Flat<N> {
    let Line { x, w, d, .. } = *line;
    let n = e1.cross(e2);
    Flat { n, num: n.dot(&(*a * w - x)), den: n.dot(&d) }
}

/// The triangle's plane before `line`.
pub(crate) fn flat<const N: usize>(line: &Line<N>, t: &Triangle, scale: i64) -> Flat<N> {
    plane_of(line, &corner_and_sides(t, scale))
}

/// Where `line`, which starts elsewhere, meets the triangle.
pub(crate) fn intersect<const N: usize>(
    line: &Line<N>,
    t: &Triangle,
    scale: i64,
) -> Result<Option<(Along<N>, bool)>, Unsure> {
    let corners = corner_and_sides(t, scale);
    let flat = plane_of(line, &corners);
    let [a, e1, e2] = corners;
    let Line { x, w, d, .. } = *line;
    let q = (a * w - x).cross(&d);
    let (b1, b2) = (e2.dot(&q), -e1.dot(&q));
    let weights = [flat.den * w - b1 - b2, b1, b2].map(|b| b.sign());
    let sure = |s: i32| weights.iter().any(|w| matches!(w, Ok(x) if *x == s));
    if sure(1) && sure(-1) {
        return Ok(None);
    }
    flat.intersect(weights)
}
