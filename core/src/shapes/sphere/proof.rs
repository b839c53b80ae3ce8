//! A sphere before a line in numbers that prove what is zero.

use crate::numeric::{Ball, Balls, Roots, Unsure};
use crate::scene::Sphere;
use crate::shapes::Decision;
use crate::shapes::exact::Met;
use crate::shapes::proof::{Along, Line, Proof, Spot};

/// a·t² + 2b·t + c = 0 for the sphere and the line, t over the line's w: a, b, c.
fn chord<const N: usize>(line: &Line<N>, sphere: &Sphere) -> (Ball<N>, Ball<N>, Ball<N>) {
    let Line { x, w, d, scale, .. } = *line;
    let oc = x - Balls::scaled(sphere.center, scale) * w;
    let r = Ball::scaled(sphere.radius, scale) * w;
    (d.dot(&d), oc.dot(&d), oc.dot(&oc) - r * r)
}

impl Proof for Sphere {
    fn intersect<const N: usize>(&self, line: &Line<N>, own: Option<Decision>, roots: &mut Roots) -> Met<Along<N>> {
        if own.is_some_and(|own| !own.inside) {
            return Ok(None);
        }
        let (a, b, c) = chord(line, self);
        let other = Along { num: -b.doubled(), den: a };
        if own.is_some() {
            return Ok(Some((other, true)));
        }
        Ok(match c.sign()? {
            0 => (b.sign()? < 0).then_some((other, true)),
            -1 => Some((Along { num: (b * b - a * c).sqrt(roots) - b, den: a }, true)),
            _ => {
                // A line that misses may be square to the way to the centre.
                let disc = b * b - a * c;
                let cuts = disc.sign();
                if matches!(cuts, Ok(-1)) || b.sign()? >= 0 {
                    return Ok(None);
                }
                match cuts? {
                    0 => Some((Along { num: -b, den: a }, false)),
                    _ => Some((Along { num: -b - disc.sqrt(roots), den: a }, false)),
                }
            }
        })
    }

    fn spot<const N: usize>(&self, line: &Line<N>, met: Decision, roots: &mut Roots) -> Result<Spot<N>, Unsure> {
        let Line { x, w, d, scale, from } = *line;
        let (a, b, c) = chord(line, self);
        let num = if from.is_some_and(|f| f.id == met.id) {
            -b.doubled()
        } else {
            let disc = b * b - a * c;
            let root = match disc.sign() {
                Ok(s) if s <= 0 => Ball::ZERO,
                // Of what is hardly above zero, the root is near zero as well.
                _ => disc.sqrt(roots),
            };
            if met.inside { root - b } else { -b - root }
        };
        let (x, w) = (x * a + d * num, w * a);
        let r = Ball::scaled(self.radius, scale) * w;
        let n = x - Balls::scaled(self.center, scale) * w;
        Ok(Spot { x, w, n, nn: r * r, turned: met.inside, decision: met })
    }
}
