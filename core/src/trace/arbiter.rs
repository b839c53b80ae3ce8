//! Decisions in 512-bit arithmetic, along the whole path from the camera.
//!
//! The fast tests know their error and pass on what they cannot tell apart: an edge met to
//! within rounding, two surfaces at nearly one distance, a start that may lie on another
//! surface. Here the path is followed again in world coordinates exactly as the scene gives
//! them, and the question is answered among the few objects it concerns. A quantity less
//! than 2^−[`TIE`] of its own terms is zero: an exact event (a tangent, a shared edge, equal
//! distances), whose outcome the image model defines.

use std::cmp::Ordering;

use glam::DVec3;

use crate::geometry::local::{Kind, kind, surface_and_order};
use crate::geometry::{Local, ObjectId};
use crate::precise;
use crate::scene::{PlanePosition, Scene};

/// Bits of the wide numbers: 512.
pub(crate) type Big = precise::Big<8>;
/// Vectors of them.
pub(crate) type Vector = precise::Vector<8>;

/// A difference this many bits below its terms is zero.
const TIE: i64 = 380;

/// What a ray meets: which object, and for a sphere from which side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Decision {
    pub(crate) id: ObjectId,
    /// Whether the inner side of a sphere is struck; false for other objects.
    pub(crate) inside: bool,
}

/// A ray of real arithmetic (to 512 bits), in world coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactRay {
    pub(crate) o: Vector,
    pub(crate) d: Vector,
    /// The surface it starts on.
    pub(crate) from: Option<Decision>,
}

/// A point of a surface, of real arithmetic.
pub(crate) struct ExactHit {
    pub(crate) p: Vector,
    /// Unit normal, turned to the side the ray strikes.
    pub(crate) n: Vector,
    pub(crate) decision: Decision,
}

/// The sign of `x`, 0 where it vanishes beside `terms`.
fn sign(x: &Big, terms: &Big) -> i32 {
    if x.exponent() < terms.exponent().saturating_sub(TIE) { 0 } else { x.signum() }
}

/// The order of `a` and `b`, equal where their difference vanishes beside them.
pub(crate) fn compare(a: &Big, b: &Big) -> Ordering {
    let terms = if a.abs() > b.abs() { a.abs() } else { b.abs() };
    sign(&(*a - *b), &terms).cmp(&0)
}

/// A triangle's first corner and its sides, as real numbers.
fn triangle(scene: &Scene, i: usize) -> (Vector, Vector, Vector) {
    let t = &scene.triangles()[i];
    let [a, b, c] = t.written.map(Vector::new);
    if t.by_sides() { (a, b, c) } else { (a, b - a, c - a) }
}

/// A plane's normal as written, and its offset along it: n · P = offset.
fn plane(scene: &Scene, i: usize) -> (Vector, Big) {
    let p = &scene.planes()[i];
    let n = Vector::new(p.normal);
    let offset = match p.position {
        PlanePosition::Point(q) => n.dot(&Vector::new(q)),
        PlanePosition::Distance(d) => Big::new(d) * n.length(),
    };
    (n, offset)
}

/// −2 (o − c)·d / d·d: where a line through a point of a sphere meets it again.
fn other_root(ray: &ExactRay, c: &Vector) -> Big {
    ((ray.o - *c).dot(&ray.d)).scale(1).div(ray.d.dot(&ray.d)) * Big::new(-1.0)
}

/// Where `ray` first meets object `id` at t > 0, and whether that is a sphere's inner side.
pub(crate) fn meet(scene: &Scene, ray: &ExactRay, id: ObjectId) -> Option<(Big, bool)> {
    let own = ray.from.filter(|f| f.id == id);
    match kind(scene, id) {
        // A line meets a flat surface once.
        Kind::Plane(_) | Kind::Triangle(_) if own.is_some() => None,
        Kind::Plane(i) => {
            let (n, offset) = plane(scene, i);
            let den = n.dot(&ray.d);
            if sign(&den, &(n.length() * ray.d.length())) == 0 {
                return None;
            }
            let along = n.dot(&ray.o);
            let num = offset - along;
            let terms = offset.abs() + n.length() * ray.o.length();
            (sign(&num, &terms) * den.signum() > 0).then(|| (num.div(den), false))
        }
        Kind::Triangle(i) => {
            let (a, e1, e2) = triangle(scene, i);
            let n = e1.cross(&e2);
            let den = n.dot(&ray.d);
            let p0 = a - ray.o;
            if sign(&den, &(e1.length() * e2.length() * ray.d.length())) == 0 {
                return None;
            }
            let num = n.dot(&p0);
            let magnitude = e1.length() * e2.length() * (a.length() + ray.o.length());
            if sign(&num, &magnitude) * den.signum() <= 0 {
                return None;
            }
            // Barycentric weights times den, by the moments relative to p0.
            let q = p0.cross(&ray.d);
            let b1 = e2.dot(&q);
            let b2 = -e1.dot(&q);
            let b0 = den - b1 - b2;
            let inside =
                [(b0, e1.length() + e2.length()), (b1, e2.length()), (b2, e1.length())].iter().all(|(b, edge)| {
                    let terms = *edge * (a.length() + ray.o.length()) * ray.d.length();
                    sign(b, &terms) * den.signum() >= 0
                });
            inside.then(|| (num.div(den), false))
        }
        Kind::Sphere(i) => {
            let s = &scene.spheres()[i];
            let (c, r) = (Vector::new(s.center), Big::new(s.radius));
            if let Some(own) = own {
                return own.inside.then(|| (other_root(ray, &c), true));
            }
            let oc = ray.o - c;
            let (a, b) = (ray.d.dot(&ray.d), oc.dot(&ray.d));
            let (oc2, rr) = (oc.dot(&oc), r * r);
            let cc = oc2 - rr;
            let disc = b * b - a * cc;
            let root = match sign(&disc, &(a * (oc2 + rr))) {
                -1 => return None,
                0 => Big::ZERO,
                _ => disc.sqrt(),
            };
            let start = sign(&cc, &(oc2 + rr));
            match start {
                // Outside: both roots lie on one side of the start.
                1 => (b.signum() < 0).then(|| ((-b - root).div(a), false)),
                -1 => Some(((root - b).div(a), true)),
                // On the sphere: 0 is one root, the other counts if it lies ahead.
                _ => (sign(&b, &(oc2.sqrt() * a.sqrt())) < 0).then(|| (b.scale(1).div(a) * Big::new(-1.0), true)),
            }
        }
    }
}

/// The nearest of `candidates` along `ray`; equal distances go to the first in the document.
pub(crate) fn closest(
    scene: &Scene,
    ray: &ExactRay,
    candidates: impl Iterator<Item = ObjectId>,
) -> Option<(Decision, Big)> {
    let mut best: Option<(Decision, Big, u32)> = None;
    for id in candidates {
        let Some((t, inside)) = meet(scene, ray, id) else { continue };
        let order = surface_and_order(scene, id).1;
        let nearer = best.as_ref().is_none_or(|(_, bt, bo)| match compare(&t, bt) {
            Ordering::Less => true,
            Ordering::Equal => order < *bo,
            Ordering::Greater => false,
        });
        if nearer {
            best = Some((Decision { id, inside }, t, order));
        }
    }
    best.map(|(d, t, _)| (d, t))
}

/// Whether one of `candidates` meets the open segment from `ray.o` to `ray.o + ray.d`.
pub(crate) fn occluded(scene: &Scene, ray: &ExactRay, mut candidates: impl Iterator<Item = ObjectId>) -> bool {
    let one = Big::new(1.0);
    candidates.any(|id| meet(scene, ray, id).is_some_and(|(t, _)| compare(&t, &one) == Ordering::Less))
}

/// The point where `ray` meets `decision`, known to be what it meets.
pub(crate) fn hit(scene: &Scene, ray: &ExactRay, decision: Decision) -> ExactHit {
    let (t, n) = match kind(scene, decision.id) {
        Kind::Plane(i) => {
            let (n, offset) = plane(scene, i);
            ((offset - n.dot(&ray.o)).div(n.dot(&ray.d)), n)
        }
        Kind::Triangle(i) => {
            let (a, e1, e2) = triangle(scene, i);
            let n = e1.cross(&e2);
            (n.dot(&(a - ray.o)).div(n.dot(&ray.d)), n)
        }
        Kind::Sphere(i) => {
            let s = &scene.spheres()[i];
            let (c, r) = (Vector::new(s.center), Big::new(s.radius));
            let t = if ray.from.is_some_and(|f| f.id == decision.id) {
                other_root(ray, &c)
            } else {
                let oc = ray.o - c;
                let (a, b) = (ray.d.dot(&ray.d), oc.dot(&ray.d));
                let root = (b * b - a * (oc.dot(&oc) - r * r)).sqrt();
                (if decision.inside { root - b } else { -b - root }).div(a)
            };
            (t, ray.o + ray.d * t - c)
        }
    };
    let n = n.normalize();
    let n = match kind(scene, decision.id) {
        Kind::Sphere(_) if decision.inside => -n,
        Kind::Sphere(_) => n,
        _ if n.dot(&ray.d).signum() > 0 => -n,
        _ => n,
    };
    ExactHit { p: ray.o + ray.d * t, n, decision }
}

impl ExactHit {
    /// The ray reflected from here.
    pub(crate) fn reflect(&self, d: &Vector) -> ExactRay {
        let d = *d - self.n * self.n.dot(d).scale(1);
        ExactRay { o: self.p, d, from: Some(self.decision) }
    }

    /// The segment from here to `light`, a world point.
    pub(crate) fn towards(&self, light: DVec3) -> ExactRay {
        ExactRay { o: self.p, d: Vector::new(light) - self.p, from: Some(self.decision) }
    }

    /// n · l, l the unit vector to `light`; 0 where the light is on the surface itself.
    pub(crate) fn cosine(&self, light: DVec3) -> f64 {
        let l = Vector::new(light) - self.p;
        let terms = self.p.length() + Vector::new(light).length();
        let along = self.n.dot(&l);
        if sign(&along, &terms) <= 0 { 0.0 } else { along.div(l.length()).to_f64() }
    }
}

/// A world point in local space, rounded once.
pub(crate) fn to_local(local: &Local, scene: &Scene, p: &Vector) -> DVec3 {
    (*p - Vector::new(scene.camera().location())).scale(-i64::from(local.power)).to_f64()
}
