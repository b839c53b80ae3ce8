//! What all shapes have in common before a line in numbers that prove what is zero: see `exact::proof`.

use std::cmp::Ordering;

use super::exact::Met;
use super::{Decision, Listed, ObjectId, Shape, of_shape};
use crate::numeric::{Ball, Balls, Roots, Unsure};
use crate::scene::Scene;

/// A distance along a line: num / den, and both over the line's w.
#[derive(Clone, Copy)]
pub(crate) struct Along<const N: usize> {
    pub(crate) num: Ball<N>,
    /// Above zero.
    pub(crate) den: Ball<N>,
}

impl<const N: usize> Along<N> {
    pub(crate) fn compare(&self, o: &Self) -> Result<Ordering, Unsure> {
        Ok((self.num * o.den - o.num * self.den).sign()?.cmp(&0))
    }
}

/// A ray from X/w along d.
#[derive(Clone, Copy)]
pub(crate) struct Line<const N: usize> {
    pub(crate) x: Balls<N>,
    /// Above zero.
    pub(crate) w: Ball<N>,
    pub(crate) d: Balls<N>,
    /// Lengths times 2^scale are integers.
    pub(crate) scale: i64,
    /// The surface it starts on.
    pub(crate) from: Option<Decision>,
}

/// A point X/w of a surface, and a normal there of the square nn: outward or upward, not turned to the ray.
pub(crate) struct Spot<const N: usize> {
    pub(crate) x: Balls<N>,
    pub(crate) w: Ball<N>,
    pub(crate) n: Balls<N>,
    pub(crate) nn: Ball<N>,
    pub(crate) turned: bool,
    pub(crate) decision: Decision,
}

/// A plane or triangle before a line.
pub(crate) struct Flat<const N: usize> {
    pub(crate) n: Balls<N>,
    pub(crate) num: Ball<N>,
    pub(crate) den: Ball<N>,
}

impl<const N: usize> Flat<N> {
    /// The distance, where the line leans as this sign says.
    pub(crate) fn along(&self, leans: i32) -> Along<N> {
        if leans < 0 { Along { num: -self.num, den: -self.den } } else { Along { num: self.num, den: self.den } }
    }

    /// Where the line meets the surface, within which it is if none of the `weights`' signs is against the others.
    pub(super) fn intersect(&self, weights: [Result<i32, Unsure>; 3]) -> Met<Along<N>> {
        let ahead = self.num.sign();
        if matches!(ahead, Ok(0)) {
            return Ok(None);
        }
        let leans = self.den.sign()?;
        if leans == 0 || ahead? * leans < 0 {
            return Ok(None);
        }
        for weight in weights {
            if weight? * leans < 0 {
                return Ok(None);
            }
        }
        Ok(Some((self.along(leans), false)))
    }

    /// The point where `line` meets the surface, known to be what it meets.
    pub(crate) fn spot(self, line: &Line<N>, met: Decision) -> Result<Spot<N>, Unsure> {
        let Line { x, w, d, .. } = *line;
        let leans = self.den.sign()?;
        let Along { num, den } = self.along(leans);
        let n = self.n;
        Ok(Spot { x: x * den + d * num, w: w * den, n, nn: n.dot(&n), turned: leans > 0, decision: met })
    }
}

impl<const N: usize> Spot<N> {
    /// The ray `line`, which met this, mirrored here.
    pub(crate) fn reflect(&self, line: &Line<N>) -> Line<N> {
        let d = line.d * self.nn - self.n * self.n.dot(&line.d).doubled();
        Line { x: self.x, w: self.w, d, from: Some(self.decision), ..*line }
    }
}

/// A shape before a line in numbers that prove what is zero.
pub(crate) trait Proof: Shape {
    /// Where `line`, which starts on the object as `own` says, if it does, first meets it. Of what has no inside, only
    /// lines that start elsewhere are asked about.
    fn intersect<const N: usize>(&self, line: &Line<N>, own: Option<Decision>, roots: &mut Roots) -> Met<Along<N>>;

    /// The point where `line` meets the object, which `met` is known to be.
    fn spot<const N: usize>(&self, line: &Line<N>, met: Decision, roots: &mut Roots) -> Result<Spot<N>, Unsure>;
}

/// Where `line` first meets object `id`.
pub(crate) fn intersect<const N: usize>(
    scene: &Scene,
    line: &Line<N>,
    id: ObjectId,
    roots: &mut Roots,
) -> Met<Along<N>> {
    let own = line.from.filter(|f| f.id == id);
    of_shape!(scene, id, O, i => {
        if O::is_left_by(own) { Ok(None) } else { O::all(scene)[i].intersect(line, own, roots) }
    })
}

/// The point where `line` meets `met`, known to be what it meets.
pub(crate) fn spot<const N: usize>(
    scene: &Scene,
    line: &Line<N>,
    met: Decision,
    roots: &mut Roots,
) -> Result<Spot<N>, Unsure> {
    of_shape!(scene, met.id, O, i => O::all(scene)[i].spot(line, met, roots))
}
