//! Decisions in wide arithmetic, along the whole path from the camera.
//!
//! The fast tests know their error and pass on what they cannot tell apart: an edge met to
//! within rounding, two surfaces at nearly one distance, a start that may lie on another
//! surface. Here the path is followed again in world coordinates exactly as the scene gives
//! them, and the question is answered among the few objects it concerns.
//!
//! Numbers have 256 bits first. A quantity that vanishes beside its own terms to more than
//! their share of bits is [`Unsure`], and the question is put again with 1536: enough for
//! terms of which one is the smallest f64 and another is 1. What vanishes there too is zero: an exact event (a tangent, a shared edge, equal distances), whose outcome
//! the image model defines.

use std::cmp::Ordering;

use glam::DVec3;

use crate::geometry::local::{Kind, kind, surface_and_order};
use crate::geometry::{Local, ObjectId, U};
use crate::precise::{Big, Vector};
use crate::scene::{PlanePosition, Scene};

/// Limbs of the numbers asked first, and of those asked last.
pub(crate) const FIRST: usize = 4;
pub(crate) const LAST: usize = 24;

/// A difference more than three quarters of the bits below its terms is not told from zero.
const fn tie(limbs: usize) -> i64 {
    48 * limbs as i64
}

/// These numbers are not wide enough to tell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unsure;

/// What a ray meets: which object, and for a sphere from which side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Decision {
    pub(crate) id: ObjectId,
    /// Whether the inner side of a sphere is struck; false for other objects.
    pub(crate) inside: bool,
}

/// A ray of real arithmetic, to 64·N bits, in world coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactRay<const N: usize> {
    pub(crate) o: Vector<N>,
    pub(crate) d: Vector<N>,
    /// The surface it starts on.
    pub(crate) from: Option<Decision>,
}

/// A point of a surface, of real arithmetic.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactHit<const N: usize> {
    pub(crate) p: Vector<N>,
    /// Outward or upward normal, of length `length`, not turned to the ray.
    normal: Vector<N>,
    /// Its square.
    square: Big<N>,
    /// Whether the ray strikes the other side.
    turned: bool,
    pub(crate) decision: Decision,
}

/// The sign of `x`, 0 where it vanishes beside `terms`.
fn sign<const N: usize>(x: &Big<N>, terms: &Big<N>) -> Result<i32, Unsure> {
    if x.exponent() >= terms.exponent().saturating_sub(tie(N)) {
        Ok(x.signum())
    } else if N < LAST {
        Err(Unsure)
    } else {
        Ok(0)
    }
}

/// The order of `a` and `b`, equal where their difference vanishes beside them.
pub(crate) fn compare<const N: usize>(a: &Big<N>, b: &Big<N>) -> Result<Ordering, Unsure> {
    let terms = if a.abs() > b.abs() { a.abs() } else { b.abs() };
    Ok(sign(&(*a - *b), &terms)?.cmp(&0))
}

/// A triangle's first corner and its sides, as real numbers.
fn triangle<const N: usize>(scene: &Scene, i: usize) -> (Vector<N>, Vector<N>, Vector<N>) {
    let t = &scene.triangles()[i];
    let [a, b, c] = t.written.map(Vector::new);
    if t.by_sides() { (a, b, c) } else { (a, b - a, c - a) }
}

/// A plane's normal as written, and its offset along it: n · P = offset.
fn plane<const N: usize>(scene: &Scene, i: usize) -> (Vector<N>, Big<N>) {
    let p = &scene.planes()[i];
    let n = Vector::new(p.normal);
    let offset = match p.position {
        PlanePosition::Point(q) => n.dot(&Vector::new(q)),
        PlanePosition::Distance(d) => Big::new(d) * n.length(),
    };
    (n, offset)
}

/// −2 (o − c)·d / d·d: where a line through a point of a sphere meets it again.
fn other_root<const N: usize>(ray: &ExactRay<N>, c: &Vector<N>) -> Big<N> {
    -(ray.o - *c).dot(&ray.d).scale(1).over(ray.d.dot(&ray.d))
}

/// |v| up to a factor below 2: its largest component. Enough for terms.
fn size<const N: usize>(v: &Vector<N>) -> Big<N> {
    let [x, y, z] = v.0.map(Big::abs);
    x.max(y).max(z)
}

/// Where `ray` first meets object `id` at t > 0, and whether that is a sphere's inner side.
pub(crate) fn meet<const N: usize>(
    scene: &Scene,
    ray: &ExactRay<N>,
    id: ObjectId,
) -> Result<Option<(Big<N>, bool)>, Unsure> {
    let own = ray.from.filter(|f| f.id == id);
    match kind(scene, id) {
        // A line meets a flat surface once.
        Kind::Plane(_) | Kind::Triangle(_) if own.is_some() => Ok(None),
        Kind::Plane(i) => {
            let (n, offset) = plane(scene, i);
            let den = n.dot(&ray.d);
            let leans = sign(&den, &(size(&n) * size(&ray.d)))?;
            if leans == 0 {
                return Ok(None);
            }
            let num = offset - n.dot(&ray.o);
            let terms = offset.abs() + size(&n) * size(&ray.o);
            Ok((sign(&num, &terms)? * leans > 0).then(|| (num.over(den), false)))
        }
        Kind::Triangle(i) => meet_triangle(scene, ray, i),
        Kind::Sphere(i) => {
            let s = &scene.spheres()[i];
            let (c, r) = (Vector::new(s.center), Big::new(s.radius));
            if let Some(own) = own {
                return Ok(own.inside.then(|| (other_root(ray, &c), true)));
            }
            let oc = ray.o - c;
            let (a, b) = (ray.d.dot(&ray.d), oc.dot(&ray.d));
            let (oc2, rr) = (oc.dot(&oc), r * r);
            let cc = oc2 - rr;
            let disc = b * b - a * cc;
            let root = match sign(&disc, &(a * (oc2 + rr)))? {
                -1 => return Ok(None),
                0 => Big::ZERO,
                _ => disc.sqrt(),
            };
            Ok(match sign(&cc, &(oc2 + rr))? {
                // Outside: both roots lie on one side of the start.
                1 => (b.signum() < 0).then(|| ((-b - root).over(a), false)),
                -1 => Some(((root - b).over(a), true)),
                // On the sphere: 0 is one root, the other counts if it lies ahead.
                _ => (sign(&b, &(size(&oc) * size(&ray.d)))? < 0).then(|| (-b.scale(1).over(a), true)),
            })
        }
    }
}

fn meet_triangle<const N: usize>(scene: &Scene, ray: &ExactRay<N>, i: usize) -> Result<Option<(Big<N>, bool)>, Unsure> {
    let (a, e1, e2) = triangle(scene, i);
    let p0 = a - ray.o;
    // Barycentric weights times N·d, by the moments relative to p0: a line through an edge
    // gives a weight of zero, which belongs to the triangle.
    let q = p0.cross(&ray.d);
    let n = e1.cross(&e2);
    let den = n.dot(&ray.d);
    let reach = (size(&a) + size(&ray.o)) * size(&ray.d);
    let leans = sign(&den, &(size(&e1) * size(&e2) * size(&ray.d)));
    let b1 = e2.dot(&q);
    let b2 = -e1.dot(&q);
    let b0 = den - b1 - b2;
    let s1 = sign(&b1, &(size(&e2) * reach));
    let s2 = sign(&b2, &(size(&e1) * reach));
    let s0 = sign(&b0, &((size(&e1) + size(&e2)) * reach));
    // One weight surely against another settles it, whatever the rest.
    let sure = [&s0, &s1, &s2].map(|s| s.as_ref().copied().unwrap_or(0));
    if sure.contains(&1) && sure.contains(&-1) {
        return Ok(None);
    }
    let leans = leans?;
    if leans == 0 || s0? * leans < 0 || s1? * leans < 0 || s2? * leans < 0 {
        return Ok(None);
    }
    let num = n.dot(&p0);
    let terms = size(&e1) * size(&e2) * (size(&a) + size(&ray.o));
    Ok((sign(&num, &terms)? * leans > 0).then(|| (num.over(den), false)))
}

/// The nearest of `candidates` along `ray`; equal distances go to the first in the document.
pub(crate) fn closest<const N: usize>(
    scene: &Scene,
    ray: &ExactRay<N>,
    candidates: impl Iterator<Item = ObjectId>,
) -> Result<Option<(Decision, Big<N>)>, Unsure> {
    let mut best: Option<(Decision, Big<N>, u32)> = None;
    for id in candidates {
        let Some((t, inside)) = meet(scene, ray, id)? else { continue };
        let order = surface_and_order(scene, id).1;
        let nearer = match &best {
            None => true,
            Some((_, bt, bo)) => match compare(&t, bt)? {
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
    scene: &Scene,
    ray: &ExactRay<N>,
    candidates: impl Iterator<Item = ObjectId>,
) -> Result<bool, Unsure> {
    let one = Big::new(1.0);
    for id in candidates {
        if let Some((t, _)) = meet(scene, ray, id)?
            && compare(&t, &one)? == Ordering::Less
        {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The point where `ray` meets `decision`, known to be what it meets.
pub(crate) fn hit<const N: usize>(scene: &Scene, ray: &ExactRay<N>, decision: Decision) -> Result<ExactHit<N>, Unsure> {
    let flat = |num: Big<N>, terms: Big<N>, n: Vector<N>| {
        // A distance that vanishes beside its terms has lost its digits.
        sign(&num, &terms)?;
        let den = n.dot(&ray.d);
        let p = ray.o + ray.d * num.over(den);
        Ok(ExactHit { p, normal: n, square: n.dot(&n), turned: den.signum() > 0, decision })
    };
    match kind(scene, decision.id) {
        Kind::Plane(i) => {
            let (n, offset) = plane(scene, i);
            flat(offset - n.dot(&ray.o), offset.abs() + size(&n) * size(&ray.o), n)
        }
        Kind::Triangle(i) => {
            let (a, e1, e2) = triangle(scene, i);
            let n = e1.cross(&e2);
            let terms = size(&e1) * size(&e2) * (size(&a) + size(&ray.o));
            flat(n.dot(&(a - ray.o)), terms, n)
        }
        Kind::Sphere(i) => {
            let s = &scene.spheres()[i];
            let (c, r) = (Vector::new(s.center), Big::new(s.radius));
            let t = if ray.from.is_some_and(|f| f.id == decision.id) {
                other_root(ray, &c)
            } else {
                let oc = ray.o - c;
                let (a, b) = (ray.d.dot(&ray.d), oc.dot(&ray.d));
                let (oc2, rr) = (oc.dot(&oc), r * r);
                let cc = oc2 - rr;
                sign(&cc, &(oc2 + rr))?;
                let root = (b * b - a * cc).sqrt();
                // Of the two forms of each root, the one that subtracts nothing.
                match decision.inside {
                    false => cc.over(root - b),
                    true if b.signum() > 0 && !cc.is_zero() => -cc.over(root + b),
                    true => (root - b).over(a),
                }
            };
            let p = ray.o + ray.d * t;
            // The normal is a difference of places: it must keep digits beside them.
            sign(&r, &(size(&p) + size(&c)))?;
            Ok(ExactHit { p, normal: p - c, square: r * r, turned: decision.inside, decision })
        }
    }
}

impl<const N: usize> ExactHit<N> {
    /// The same point in M limbs.
    pub(crate) fn resize<const M: usize>(&self) -> ExactHit<M> {
        ExactHit {
            p: self.p.resize(),
            normal: self.normal.resize(),
            square: self.square.resize(),
            turned: self.turned,
            decision: self.decision,
        }
    }

    /// The ray reflected from here.
    pub(crate) fn reflect(&self, d: &Vector<N>) -> ExactRay<N> {
        let along = self.normal.dot(d).scale(1).over(self.square);
        ExactRay { o: self.p, d: *d - self.normal * along, from: Some(self.decision) }
    }

    /// The segment from here to `light`, a world point.
    pub(crate) fn towards(&self, light: DVec3) -> ExactRay<N> {
        ExactRay { o: self.p, d: Vector::new(light) - self.p, from: Some(self.decision) }
    }

    /// The unit normal, turned to the side the ray strikes.
    pub(crate) fn normal(&self) -> DVec3 {
        let n = rounded(&self.normal).normalize();
        if self.turned { -n } else { n }
    }

    /// n · l, l the unit vector to `light`; 0 where the light is on the surface's plane, to f64.
    pub(crate) fn cosine(&self, light: DVec3) -> f64 {
        let l = Vector::new(light) - self.p;
        let cosine = self.normal().dot(rounded(&l).normalize());
        if cosine < 16.0 * U { 0.0 } else { cosine }
    }
}

/// `v` scaled so that its largest component is about 1, each component rounded once.
fn rounded<const N: usize>(v: &Vector<N>) -> DVec3 {
    if v.is_zero() { DVec3::ZERO } else { v.scale(-v.exponent()).to_f64() }
}

/// A world point in local space, rounded once.
pub(crate) fn to_local<const N: usize>(local: &Local, scene: &Scene, p: &Vector<N>) -> DVec3 {
    (*p - Vector::new(scene.camera().location())).scale(-i64::from(local.power)).to_f64()
}
