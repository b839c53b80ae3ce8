//! Decisions in wide arithmetic, along the whole path from the camera.
//!
//! The fast tests know their error and pass on what they cannot tell apart: an edge met to
//! within rounding, two surfaces at nearly one distance, a start that may lie on another
//! surface. Here the path is followed again in world coordinates exactly as the scene gives
//! them, and the question is answered among the few objects it concerns.
//!
//! **Certainty.** Numbers have 256 bits first, then 1536. Beside its numbers a ray carries bounds of
//! how far they may be from the real ones, and every decision a bound of its own: what exceeds its
//! bound has the sign it shows. What does not is [`Unsure`]: it may be an exact event (a tangent, a
//! shared edge, equal distances), whose outcome the image model defines, and that is what
//! `trace::proof` finds out. What no width can tell, because the path behind it has used the digits
//! up, is decided by the numbers as they are, the same everywhere, and counted
//! (`RayCounts::unresolved`).
//!
//! **Bounds.** `lateral` bounds how far the ray's line passes from the real one at the start,
//! `place` how far the start itself is from the real one, `turn` the direction's relative error. A
//! flat mirror is an isometry and leaves `lateral` and `turn` as they are, however many follow one
//! another; a sphere met at distance h from the middle of its chord turns the ray by up to
//! 4·place/r. Each operation on numbers adds [`Slack::rounding`] of its terms.

mod lines;

use std::cmp::Ordering;

use glam::DVec3;

pub(crate) use crate::numeric::Unsure;
use crate::numeric::{Big, Bound, U, Vector};
use crate::scene::Scene;
use crate::shapes::{Decision, Kind, Local, ObjectId, kind, surface_and_order};
use lines::{Chord, Crossing, ExactPlane, cross_triangle, times, triangle};
pub(crate) use lines::{ExactPlanes, largest, size};

use super::prepared::PreparedScene;

/// Limbs of the numbers asked first, and of those asked last.
pub(crate) const FIRST: usize = 4;
pub(crate) const LAST: usize = 24;

/// Of numbers that are taken as they are, what is this many bits below its terms is zero.
const fn tie(limbs: usize) -> i64 {
    48 * limbs as i64
}

/// Nothing that is used as a value may be wronger than 2^−VALUE of itself.
const VALUE: i64 = 60;

/// A sum of a few products of numbers of N limbs is rounded by far less than this share of its terms.
fn rounding<const N: usize>() -> Bound {
    Bound::power(20 - 64 * N as i64)
}

/// How wrong a ray may be; see the module's bounds.
#[derive(Clone, Copy, Debug)]
struct Slack {
    lateral: Bound,
    position: Bound,
    turn: Bound,
    /// What an operation adds; zero where numbers are taken as they are.
    rounding: Bound,
}

/// A ray of real arithmetic, to 64·N bits, in world coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactRay<const N: usize> {
    pub(crate) o: Vector<N>,
    pub(crate) d: Vector<N>,
    /// The surface it starts on.
    pub(crate) from: Option<Decision>,
    slack: Slack,
}

/// A point of a surface, of real arithmetic.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactHit<const N: usize> {
    pub(crate) p: Vector<N>,
    /// Outward or upward normal, not turned to the ray.
    normal: Vector<N>,
    /// 2(n·d) / n²: how many normals the mirrored ray's direction lies back from the ray's.
    back: Big<N>,
    /// Whether the ray strikes the other side.
    turned: bool,
    pub(crate) decision: Decision,
    /// Of the ray mirrored here.
    slack: Slack,
    /// Relative error of the normal.
    bend: Bound,
}

/// How far along a ray something is met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Distance<const N: usize> {
    pub(crate) t: Big<N>,
    error: Bound,
}

impl<const N: usize> Distance<N> {
    /// The order of two distances.
    fn compare(&self, o: &Self) -> Result<Ordering, Unsure> {
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
fn sign<const N: usize>(x: &Big<N>, terms: Bound, error: Bound) -> Result<i32, Unsure> {
    if error == Bound::ZERO {
        let zero = terms.exponent().saturating_sub(tie(N));
        return Ok(if x.exponent() >= zero { x.signum() } else { 0 });
    }
    // At least twice the error, so that quotients by x are bounded as well.
    if x.exponent() >= error.exponent().saturating_add(2) { Ok(x.signum()) } else { Err(Unsure) }
}

/// Where `ray` first meets object `id` at t > 0, and whether that is a sphere's inner side.
pub(crate) fn intersect<const N: usize>(
    prepared: &PreparedScene,
    ray: &ExactRay<N>,
    id: ObjectId,
) -> Result<Option<(Distance<N>, bool)>, Unsure> {
    let scene = &prepared.scene;
    let own = ray.from.filter(|f| f.id == id);
    let rounding = ray.slack.rounding;
    match kind(scene, id) {
        // A line meets a flat surface once.
        Kind::Plane(_) | Kind::Triangle(_) if own.is_some() => Ok(None),
        Kind::Plane(i) => {
            let crossing = ExactPlane::of(prepared, i).cross(ray);
            let leans = crossing.leans()?;
            Ok((leans != 0 && crossing.ahead()? * leans > 0).then(|| (crossing.distance(rounding), false)))
        }
        Kind::Triangle(i) => intersect_triangle(ray, &triangle(scene, i)),
        Kind::Sphere(i) => {
            let s = &scene.spheres()[i];
            let chord = Chord::new(ray, &Vector::new(s.center), Big::new(s.radius));
            if let Some(own) = own {
                return Ok(own.inside.then(|| (chord.other(rounding), true)));
            }
            let Some(root) = chord.root()? else { return Ok(None) };
            Ok(match sign(&chord.c, chord.c_terms, chord.c_error)? {
                // Outside: both roots lie on one side of the start.
                1 => (chord.b.signum() < 0).then(|| (chord.distance(root, false, rounding), false)),
                -1 => Some((chord.distance(root, true, rounding), true)),
                // On the sphere: 0 is one root, the other counts if it lies ahead.
                _ => (sign(&chord.b, chord.b_terms, chord.b_error)? < 0).then(|| (chord.other(rounding), true)),
            })
        }
    }
}

fn intersect_triangle<const N: usize>(
    ray: &ExactRay<N>,
    corners: &[Vector<N>; 3],
) -> Result<Option<(Distance<N>, bool)>, Unsure> {
    let [a, e1, e2] = corners;
    let (crossing, _) = cross_triangle(ray, corners);
    let p0 = *a - ray.o;
    // Barycentric weights times N·d, by the moments relative to p0: a line through an edge
    // gives a weight of zero, which belongs to the triangle.
    let q = p0.cross(&ray.d);
    let b1 = e2.dot(&q);
    let b2 = -e1.dot(&q);
    let b0 = crossing.den - b1 - b2;
    let Slack { lateral, turn, rounding, .. } = ray.slack;
    let (speed, reach) = (size(&ray.d), size(a) + size(&ray.o));
    let error = times(speed * (times(lateral, 1) + size(&p0) * times(turn, 2) + reach * rounding), 2);
    let (l1, l2, reach) = (size(e1), size(e2), reach * speed);
    let s1 = sign(&b1, l2 * reach, l2 * error);
    let s2 = sign(&b2, l1 * reach, l1 * error);
    let s0 = sign(&b0, (l1 + l2) * reach, (l1 + l2) * error + crossing.den_error);
    // One weight surely against another settles it, whatever the rest.
    let sure = [&s0, &s1, &s2].map(|s| s.as_ref().copied().unwrap_or(0));
    if sure.contains(&1) && sure.contains(&-1) {
        return Ok(None);
    }
    let leans = crossing.leans()?;
    if leans == 0 || s0? * leans < 0 || s1? * leans < 0 || s2? * leans < 0 {
        return Ok(None);
    }
    Ok((crossing.ahead()? * leans > 0).then(|| (crossing.distance(rounding), false)))
}

/// The nearest of `candidates` along `ray`; equal distances go to the first in the document.
pub(crate) fn closest<const N: usize>(
    prepared: &PreparedScene,
    ray: &ExactRay<N>,
    candidates: impl Iterator<Item = ObjectId>,
) -> Result<Option<(Decision, Distance<N>)>, Unsure> {
    let mut best: Option<(Decision, Distance<N>, u32)> = None;
    for id in candidates {
        let Some((t, inside)) = intersect(prepared, ray, id)? else { continue };
        let order = surface_and_order(&prepared.scene, id).1;
        let nearer = match &best {
            None => true,
            // No width tells equal distances behind curved mirrors; that they are equal is known of one plane.
            Some((b, _, bo)) if prepared.are_coplanar(b.id, id) => order < *bo,
            Some((_, bt, bo)) => match t.compare(bt)? {
                Ordering::Less => true,
                Ordering::Equal => order < *bo,
                Ordering::Greater => false,
            },
        };
        if nearer {
            best = Some((Decision { id, inside }, t, order));
        }
    }
    Ok(best.map(|(d, t, _)| (d, t)))
}

/// Whether one of `candidates` meets the open segment from `ray.o` to `ray.o + ray.d`.
pub(crate) fn occluded<const N: usize>(
    prepared: &PreparedScene,
    ray: &ExactRay<N>,
    candidates: impl Iterator<Item = ObjectId>,
) -> Result<bool, Unsure> {
    let one = Distance { t: Big::new(1.0), error: Bound::ZERO };
    for id in candidates {
        if let Some((t, _)) = intersect(prepared, ray, id)?
            && t.compare(&one)? == Ordering::Less
        {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The point where `ray` meets `decision`, known to be what it meets.
pub(crate) fn hit<const N: usize>(
    prepared: &PreparedScene,
    ray: &ExactRay<N>,
    decision: Decision,
) -> Result<ExactHit<N>, Unsure> {
    let scene = &prepared.scene;
    let Slack { lateral, turn, rounding, .. } = ray.slack;
    let travelled = |t: &Big<N>| (Bound::of(t) * size(&ray.d), size(&ray.o));
    let flat = |crossing: &Crossing<N>, n: Vector<N>, back: Big<N>| {
        let t = crossing.num.over(crossing.den);
        let (way, start) = travelled(&t);
        let along = n.0[largest(&n)];
        // Across the line, and what its slant makes of that on the plane.
        let delta = times(lateral, 1) + way * times(turn, 2) + rounding * (way + start);
        let off = times(rounding * crossing.num_terms, 1);
        let position = (times(crossing.den_terms, 2) * delta + off * size(&ray.d)).over(&crossing.den);
        let lateral = delta + times(off.over(&along), 1);
        // A sliver's normal has lost what its sides have in common.
        let bend = times(rounding * crossing.den_terms, 1).over(&along).over(&ray.d.0[largest(&ray.d)]);
        let slack = Slack { lateral, position, turn: turn + times(bend, 2), rounding };
        let turned = crossing.den.signum() > 0;
        Ok(ExactHit { p: ray.o + ray.d * t, normal: n, back, turned, decision, slack, bend })
    };
    match kind(scene, decision.id) {
        Kind::Plane(i) => {
            let plane = ExactPlane::of(prepared, i);
            let crossing = plane.cross(ray);
            flat(&crossing, plane.n, crossing.den * plane.fold)
        }
        Kind::Triangle(i) => {
            let (crossing, n) = cross_triangle(ray, &triangle(scene, i));
            flat(&crossing, n, crossing.den.scale(1).over(n.dot(&n)))
        }
        Kind::Sphere(i) => {
            let s = &scene.spheres()[i];
            let (c, r) = (Vector::new(s.center), Big::new(s.radius));
            let chord = Chord::new(ray, &c, r);
            let (t, sway) = if ray.from.is_some_and(|f| f.id == decision.id) {
                (chord.other(rounding).t, times(chord.b_error, 1).over(&ray.d.0[largest(&ray.d)]) + ray.slack.position)
            } else {
                let root = chord.root_of_a_hit();
                let sway = times(chord.delta, 1) + root.1.over(&ray.d.0[largest(&ray.d)]);
                (chord.distance(root, decision.inside, rounding).t, sway)
            };
            let p = ray.o + ray.d * t;
            let (way, start) = travelled(&t);
            let position = sway + rounding * (way + start + size(&c));
            let bend = times(position, 1).over(&r);
            // The normal is a difference of places: it must keep digits beside them.
            if bend != Bound::ZERO && bend.exponent() > -VALUE {
                return Err(Unsure);
            }
            let slack = Slack { lateral: position, position, turn: turn + times(bend, 2) + rounding, rounding };
            let normal = p - c;
            let back = normal.dot(&ray.d).scale(1).over(r * r);
            Ok(ExactHit { p, normal, back, turned: decision.inside, decision, slack, bend })
        }
    }
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
