//! What all shapes have in common before a line in wide numbers, with bounds of what it may be wrong by: see `exact`.

use std::cmp::Ordering;

use glam::DVec3;

use super::{Decision, Listed, Local, ObjectId, Shape, of_shape};
use crate::numeric::{Big, Bound, U, Unsure, Vector};
use crate::scene::Scene;

/// Limbs of the numbers asked first, and of those asked last.
pub(crate) const FIRST: usize = 4;
pub(crate) const LAST: usize = 24;

/// Of numbers that are taken as they are, what is this many bits below its terms is zero.
const fn tie(limbs: usize) -> i64 {
    48 * limbs as i64
}

/// Nothing that is used as a value may be wronger than 2^−VALUE of itself.
pub(crate) const VALUE: i64 = 60;

/// A sum of a few products of numbers of N limbs is rounded by far less than this share of its terms.
fn rounding<const N: usize>() -> Bound {
    Bound::power(20 - 64 * N as i64)
}

/// How wrong a ray may be; see the module's bounds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slack {
    pub(crate) lateral: Bound,
    pub(crate) position: Bound,
    pub(crate) turn: Bound,
    /// What an operation adds; zero where numbers are taken as they are.
    pub(crate) rounding: Bound,
}

/// A ray of real arithmetic, to 64·N bits, in world coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactRay<const N: usize> {
    pub(crate) o: Vector<N>,
    pub(crate) d: Vector<N>,
    /// The surface it starts on.
    pub(crate) from: Option<Decision>,
    pub(crate) slack: Slack,
}

/// A point of a surface, of real arithmetic.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactHit<const N: usize> {
    pub(crate) p: Vector<N>,
    /// Outward or upward normal, not turned to the ray.
    pub(super) normal: Vector<N>,
    /// 2(n·d) / n²: how many normals the mirrored ray's direction lies back from the ray's.
    pub(super) back: Big<N>,
    /// Whether the ray strikes the other side.
    pub(super) turned: bool,
    pub(crate) decision: Decision,
    /// Of the ray mirrored here.
    pub(super) slack: Slack,
    /// Relative error of the normal.
    pub(super) bend: Bound,
}

/// How far along a ray something is met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Distance<const N: usize> {
    pub(crate) t: Big<N>,
    pub(crate) error: Bound,
}

impl<const N: usize> Distance<N> {
    /// The order of two distances.
    pub(crate) fn compare(&self, o: &Self) -> Result<Ordering, Unsure> {
        let terms = Bound::of(&self.t) + Bound::of(&o.t);
        Ok(sign(&(self.t - o.t), terms, self.error + o.error)?.cmp(&0))
    }
}

impl<const N: usize> ExactRay<N> {
    /// A ray from `o` along `d`, which is rounded.
    pub(crate) fn new(o: DVec3, d: Vector<N>) -> Self {
        let rounding = rounding::<N>();
        let slack = Slack { lateral: Bound::ZERO, position: Bound::ZERO, turn: rounding, rounding };
        Self { o: Vector::new(o), d, from: None, slack }
    }

    /// The same ray in M limbs.
    pub(crate) fn resize<const M: usize>(&self) -> ExactRay<M> {
        ExactRay { o: self.o.resize(), d: self.d.resize(), from: self.from, slack: self.slack }
    }

    /// The same ray, its numbers taken as they are from here on.
    pub(crate) fn taken_as_it_is(self) -> Self {
        let none = Bound::ZERO;
        Self { slack: Slack { lateral: none, position: none, turn: none, rounding: none }, ..self }
    }
}

/// The sign of `x`, which may be wrong by `error`; of numbers that are taken as they are, 0 where it
/// vanishes beside `terms`.
pub(crate) fn sign<const N: usize>(x: &Big<N>, terms: Bound, error: Bound) -> Result<i32, Unsure> {
    if error == Bound::ZERO {
        let zero = terms.exponent().saturating_sub(tie(N));
        return Ok(if x.exponent() >= zero { x.signum() } else { 0 });
    }
    // At least twice the error, so that quotients by x are bounded as well.
    if x.exponent() >= error.exponent().saturating_add(2) { Ok(x.signum()) } else { Err(Unsure) }
}

/// |v| up to a factor below 2, from below: its largest component. Enough for terms.
pub(crate) fn size<const N: usize>(v: &Vector<N>) -> Bound {
    let [x, y, z] = v.0.map(|x| Bound::of(&x));
    if x.exponent() >= y.exponent().max(z.exponent()) {
        x
    } else if y.exponent() >= z.exponent() {
        y
    } else {
        z
    }
}

/// 2^k · b, for the small factors of bounds.
pub(crate) fn times(b: Bound, k: i64) -> Bound {
    b.scale(k)
}

/// A line and a plane: numerator and denominator of their distance, and what they may be wrong by.
pub(crate) struct Crossing<const N: usize> {
    pub(crate) num: Big<N>,
    pub(crate) den: Big<N>,
    pub(crate) num_terms: Bound,
    pub(crate) den_terms: Bound,
    pub(crate) num_error: Bound,
    pub(crate) den_error: Bound,
}

impl<const N: usize> Crossing<N> {
    /// `reach` bounds the places that `num` is the difference of, `length` the normal's terms.
    pub(crate) fn new(ray: &ExactRay<N>, num: Big<N>, den: Big<N>, length: Bound, reach: Bound) -> Self {
        let Slack { position, turn, rounding, .. } = ray.slack;
        let den_terms = length * size(&ray.d);
        Self {
            num,
            den,
            num_terms: length * reach,
            den_terms,
            num_error: length * (times(position, 4) + rounding * reach),
            den_error: den_terms * (times(turn, 4) + rounding),
        }
    }

    pub(crate) fn leans(&self) -> Result<i32, Unsure> {
        sign(&self.den, self.den_terms, self.den_error)
    }

    pub(crate) fn ahead(&self) -> Result<i32, Unsure> {
        sign(&self.num, self.num_terms, self.num_error)
    }

    /// The distance, where the line leans towards the plane.
    pub(crate) fn distance(&self, rounding: Bound) -> Distance<N> {
        let t = self.num.over(self.den);
        let size = Bound::of(&t);
        let error = times((self.num_error + size * self.den_error).over(&self.den), 1) + rounding * size;
        Distance { t, error }
    }

    /// The point where `ray` meets a flat surface of this normal, known to be what it meets.
    pub(super) fn hit(&self, ray: &ExactRay<N>, n: Vector<N>, back: Big<N>, decision: Decision) -> ExactHit<N> {
        let Slack { lateral, turn, rounding, .. } = ray.slack;
        let t = self.num.over(self.den);
        let (way, start) = travelled(ray, &t);
        let along = n.0[largest(&n)];
        // Across the line, and what its slant makes of that on the plane.
        let delta = times(lateral, 1) + way * times(turn, 2) + rounding * (way + start);
        let off = times(rounding * self.num_terms, 1);
        let position = (times(self.den_terms, 2) * delta + off * size(&ray.d)).over(&self.den);
        let lateral = delta + times(off.over(&along), 1);
        // A sliver's normal has lost what its sides have in common.
        let bend = times(rounding * self.den_terms, 1).over(&along).over(&ray.d.0[largest(&ray.d)]);
        let slack = Slack { lateral, position, turn: turn + times(bend, 2), rounding };
        let turned = self.den.signum() > 0;
        ExactHit { p: ray.o + ray.d * t, normal: n, back, turned, decision, slack, bend }
    }
}

/// The terms of the way along `ray` to `t`, and of its start.
pub(super) fn travelled<const N: usize>(ray: &ExactRay<N>, t: &Big<N>) -> (Bound, Bound) {
    (Bound::of(t) * size(&ray.d), size(&ray.o))
}

/// Which component is the largest.
pub(crate) fn largest<const N: usize>(v: &Vector<N>) -> usize {
    let e = v.0.map(|x| x.exponent());
    (0..3).max_by_key(|&k| e[k]).unwrap_or(0)
}

impl<const N: usize> ExactHit<N> {
    /// A point that is off by `place` at most, its normal by the share `bend`.
    pub(crate) fn known(
        p: Vector<N>,
        position: Bound,
        (normal, bend): (Vector<N>, Bound),
        back: Big<N>,
        turned: bool,
        decision: Decision,
    ) -> Self {
        let slack = Slack { lateral: position, position, turn: Bound::ZERO, rounding: rounding::<N>() };
        Self { p, normal, back, turned, decision, slack, bend }
    }

    /// How far the point may be from the real one.
    pub(crate) fn misplaced(&self) -> Bound {
        self.slack.position
    }

    /// The normal as it was found: of any length, outward or upward; and its relative error.
    pub(crate) fn raw_normal(&self) -> (&Vector<N>, Bound) {
        (&self.normal, self.bend)
    }

    /// A difference from the point, if it keeps its digits.
    fn difference(&self, d: Vector<N>) -> Result<Vector<N>, Unsure> {
        let error = self.slack.position;
        let known = error == Bound::ZERO || error.exponent() <= size(&d).exponent().saturating_sub(VALUE);
        if known { Ok(d) } else { Err(Unsure) }
    }

    /// The point in local space, each coordinate rounded once.
    pub(crate) fn in_local_space(&self, local: &Local, scene: &Scene) -> Result<DVec3, Unsure> {
        let p = self.difference(self.p - Vector::new(scene.camera().location()))?;
        Ok(p.scale(-i64::from(local.power)).to_f64())
    }

    /// The ray along `d`, which met this, reflected from here.
    pub(crate) fn reflect(&self, d: &Vector<N>) -> ExactRay<N> {
        ExactRay { o: self.p, d: *d - self.normal * self.back, from: Some(self.decision), slack: self.slack }
    }

    /// The segment from here to `light`, a world point.
    pub(crate) fn towards(&self, light: DVec3) -> ExactRay<N> {
        let d = Vector::new(light) - self.p;
        let Slack { position, rounding, .. } = self.slack;
        let turn = times(position, 1).over(&d.0[largest(&d)]) + rounding;
        let slack = Slack { lateral: position, position, turn, rounding };
        ExactRay { o: self.p, d, from: Some(self.decision), slack }
    }

    /// The unit normal, turned to the side the ray strikes.
    pub(crate) fn normal(&self) -> Result<DVec3, Unsure> {
        if self.bend != Bound::ZERO && self.bend.exponent() > -VALUE {
            return Err(Unsure);
        }
        let n = rounded(&self.normal).normalize();
        Ok(if self.turned { -n } else { n })
    }

    /// The direction of the ray along `d`, which met this, reflected from here; of about the length of `d`.
    pub(crate) fn mirrored(&self, d: &Vector<N>) -> Result<DVec3, Unsure> {
        let turn = self.slack.turn + self.bend;
        if turn != Bound::ZERO && turn.exponent() > -VALUE {
            return Err(Unsure);
        }
        Ok((*d - self.normal * self.back).to_f64())
    }

    /// n · l, l the unit vector to `light`; 0 where the light is on the surface's plane, to f64.
    pub(crate) fn cosine(&self, light: DVec3) -> Result<f64, Unsure> {
        let l = self.difference(Vector::new(light) - self.p)?;
        if l.is_zero() {
            return Ok(0.0);
        }
        let cosine = self.normal()?.dot(rounded(&l).normalize());
        Ok(if cosine < 16.0 * U { 0.0 } else { cosine })
    }
}

/// `v` scaled so that its largest component is about 1, each component rounded once.
fn rounded<const N: usize>(v: &Vector<N>) -> DVec3 {
    if v.is_zero() { DVec3::ZERO } else { v.scale(-v.exponent()).to_f64() }
}

/// What is met, and whether that is an inner side; nothing; or what is not known.
pub(crate) type Met<T> = Result<Option<(T, bool)>, Unsure>;

/// What is known, or is not.
pub(crate) type Known<T> = Result<T, Unsure>;

/// The index of an object among those of its shape, and what is kept of them.
pub(crate) type At<'a> = (usize, &'a Local);

/// A shape before a line in wide numbers.
pub(crate) trait Exact: Shape {
    /// Where `ray`, which starts on the object as `own` says, if it does, first meets it at t > 0. Of what has no
    /// inside, only rays that start elsewhere are asked about.
    fn intersect<const N: usize>(&self, at: At, ray: &ExactRay<N>, own: Option<Decision>) -> Met<Distance<N>>;

    /// The point where `ray` meets the object, which `met` is known to be.
    fn hit<const N: usize>(&self, at: At, ray: &ExactRay<N>, met: Decision) -> Result<ExactHit<N>, Unsure>;

    /// The lengths that it is given by.
    fn lengths(&self) -> ([DVec3; 3], f64);
}

/// Where `ray` first meets object `id` at t > 0.
pub(crate) fn intersect<const N: usize>(
    scene: &Scene,
    local: &Local,
    ray: &ExactRay<N>,
    id: ObjectId,
) -> Met<Distance<N>> {
    let own = ray.from.filter(|f| f.id == id);
    of_shape!(scene, id, O, i => {
        if O::is_left_by(own) { Ok(None) } else { O::all(scene)[i].intersect((i, local), ray, own) }
    })
}

/// The point where `ray` meets `met`, known to be what it meets.
pub(crate) fn hit<const N: usize>(
    scene: &Scene,
    local: &Local,
    ray: &ExactRay<N>,
    met: Decision,
) -> Known<ExactHit<N>> {
    of_shape!(scene, met.id, O, i => O::all(scene)[i].hit((i, local), ray, met))
}
