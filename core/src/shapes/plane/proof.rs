//! A plane before a line in numbers that prove what is zero.

use crate::numeric::{Ball, Balls, Roots, Unsure};
use crate::scene::{Plane, PlanePosition};
use crate::shapes::Decision;
use crate::shapes::exact::Met;
use crate::shapes::integers::direction;
use crate::shapes::proof::{Along, Flat, Line, Proof, Spot};

/// The plane before `line`.
fn flat<const N: usize>(line: &Line<N>, plane: &Plane, roots: &mut Roots) -> Flat<N> {
    let Line { x, w, d, scale, .. } = *line;
    let n = direction(plane.normal);
    let offset = match plane.position {
        PlanePosition::Point(q) => n.dot(&Balls::scaled(q, scale)),
        PlanePosition::Distance(h) => Ball::scaled(h, scale) * n.dot(&n).sqrt(roots),
    };
    Flat { n, num: offset * w - n.dot(&x), den: n.dot(&d) }
}

impl Proof for Plane {
    fn intersect<const N: usize>(&self, line: &Line<N>, _: Option<Decision>, roots: &mut Roots) -> Met<Along<N>> {
        flat(line, self, roots).intersect([Ok(0); 3])
    }

    fn spot<const N: usize>(&self, line: &Line<N>, met: Decision, roots: &mut Roots) -> Result<Spot<N>, Unsure> {
        flat(line, self, roots).spot(line, met)
    }
}
