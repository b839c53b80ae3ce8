//! A triangle before a line in numbers that prove what is zero.

use crate::numeric::{Balls, Roots, Unsure};
use crate::scene::Triangle;
use crate::shapes::Decision;
use crate::shapes::exact::Met;
use crate::shapes::proof::{Along, Flat, Line, Proof, Spot};

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

impl Proof for Triangle {
    fn intersect<const N: usize>(&self, line: &Line<N>, _: Option<Decision>, _: &mut Roots) -> Met<Along<N>> {
        let corners = corner_and_sides(self, line.scale);
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

    fn spot<const N: usize>(&self, line: &Line<N>, met: Decision, _: &mut Roots) -> Result<Spot<N>, Unsure> {
        plane_of(line, &corner_and_sides(self, line.scale)).spot(line, met)
    }
}
