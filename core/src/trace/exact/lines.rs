//! Planes, triangles and spheres before a line, in wide numbers and with bounds of what they may be wrong by.

use std::sync::OnceLock;

use super::{Distance, ExactRay, FIRST, LAST, Slack, Unsure, sign};
use crate::numeric::{Big, Bound, Vector};
use crate::scene::{Plane, PlanePosition, Scene};
use crate::trace::prepared::PreparedScene;

/// A triangle's first corner and its sides, as real numbers.
pub(super) fn triangle<const N: usize>(scene: &Scene, i: usize) -> [Vector<N>; 3] {
    let t = &scene.triangles()[i];
    let [a, b, c] = t.written.map(Vector::new);
    if t.by_sides() { [a, b, c] } else { [a, b - a, c - a] }
}

/// A plane in wide numbers: n · P = offset.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExactPlane<const N: usize> {
    pub(super) n: Vector<N>,
    pub(super) offset: Big<N>,
    /// 2 / n², what mirrors a ray.
    pub(super) fold: Big<N>,
    /// The normal's size, and how far from the origin the point is that the offset was found by.
    pub(super) length: Bound,
    pub(super) reach: Bound,
}

/// A plane at both widths; at the last, which few scenes ask for, from when it is asked for.
#[derive(Debug)]
pub(crate) struct ExactPlanes {
    pub(super) first: ExactPlane<FIRST>,
    pub(super) last: OnceLock<Box<ExactPlane<LAST>>>,
}

impl ExactPlanes {
    pub(crate) fn new(plane: &Plane) -> Self {
        Self { first: ExactPlane::new(plane), last: OnceLock::new() }
    }
}

impl<const N: usize> ExactPlane<N> {
    pub(super) fn new(plane: &Plane) -> Self {
        let n = Vector::new(plane.normal);
        let (offset, reach) = match plane.position {
            PlanePosition::Point(q) => {
                let q = Vector::new(q);
                (n.dot(&q), size(&q))
            }
            PlanePosition::Distance(d) => (Big::new(d) * n.length(), Bound::of(&Big::<N>::new(d)).scale(1)),
        };
        Self { n, offset, fold: Big::new(2.0).over(n.dot(&n)), length: size(&n), reach }
    }

    /// Plane `i`.
    pub(super) fn of(prepared: &PreparedScene, i: usize) -> Self {
        let ExactPlanes { first, last } = &prepared.exact_planes[i];
        if N == FIRST {
            first.resize()
        } else {
            last.get_or_init(|| Box::new(ExactPlane::new(&prepared.scene.planes()[i]))).resize()
        }
    }

    pub(super) fn resize<const M: usize>(&self) -> ExactPlane<M> {
        let Self { n, offset, fold, length, reach } = self;
        ExactPlane { n: n.resize(), offset: offset.resize(), fold: fold.resize(), length: *length, reach: *reach }
    }

    pub(super) fn cross(&self, ray: &ExactRay<N>) -> Crossing<N> {
        let reach = size(&ray.o) + self.reach;
        Crossing::new(ray, self.offset - self.n.dot(&ray.o), self.n.dot(&ray.d), self.length, reach)
    }
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
pub(super) fn times(b: Bound, k: i64) -> Bound {
    b.scale(k)
}

/// A line and a plane: numerator and denominator of their distance, and what they may be wrong by.
pub(super) struct Crossing<const N: usize> {
    pub(super) num: Big<N>,
    pub(super) den: Big<N>,
    pub(super) num_terms: Bound,
    pub(super) den_terms: Bound,
    pub(super) num_error: Bound,
    pub(super) den_error: Bound,
}

impl<const N: usize> Crossing<N> {
    /// `reach` bounds the places that `num` is the difference of, `length` the normal's terms.
    pub(super) fn new(ray: &ExactRay<N>, num: Big<N>, den: Big<N>, length: Bound, reach: Bound) -> Self {
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

    pub(super) fn leans(&self) -> Result<i32, Unsure> {
        sign(&self.den, self.den_terms, self.den_error)
    }

    pub(super) fn ahead(&self) -> Result<i32, Unsure> {
        sign(&self.num, self.num_terms, self.num_error)
    }

    /// The distance, where the line leans towards the plane.
    pub(super) fn distance(&self, rounding: Bound) -> Distance<N> {
        let t = self.num.over(self.den);
        let size = Bound::of(&t);
        let error = times((self.num_error + size * self.den_error).over(&self.den), 1) + rounding * size;
        Distance { t, error }
    }
}

/// Which component is the largest.
pub(crate) fn largest<const N: usize>(v: &Vector<N>) -> usize {
    let e = v.0.map(|x| x.exponent());
    (0..3).max_by_key(|&k| e[k]).unwrap_or(0)
}

pub(super) fn cross_triangle<const N: usize>(
    ray: &ExactRay<N>,
    [a, e1, e2]: &[Vector<N>; 3],
) -> (Crossing<N>, Vector<N>) {
    let n = e1.cross(e2);
    let length = size(e1) * size(e2);
    (Crossing::new(ray, n.dot(&(*a - ray.o)), n.dot(&ray.d), length, size(a) + size(&ray.o)), n)
}

/// A line and a sphere.
pub(super) struct Chord<const N: usize> {
    /// a·t² + 2b·t + c = 0, and b² − a·c.
    pub(super) a: Big<N>,
    pub(super) b: Big<N>,
    pub(super) c: Big<N>,
    pub(super) disc: Big<N>,
    pub(super) b_terms: Bound,
    pub(super) c_terms: Bound,
    pub(super) disc_terms: Bound,
    pub(super) b_error: Bound,
    pub(super) c_error: Bound,
    pub(super) disc_error: Bound,
    /// How far the line may be misplaced at the sphere.
    pub(super) delta: Bound,
}

impl<const N: usize> Chord<N> {
    pub(super) fn new(ray: &ExactRay<N>, center: &Vector<N>, r: Big<N>) -> Self {
        let Slack { lateral, position, turn, rounding } = ray.slack;
        let oc = ray.o - *center;
        let (a, b, rr) = (ray.d.dot(&ray.d), oc.dot(&ray.d), r * r);
        let oc2 = oc.dot(&oc);
        let c = oc2 - rr;
        let (away, speed, radius) = (size(&oc), size(&ray.d), Bound::of(&r));
        let delta = times(lateral, 1) + away * (times(turn, 2) + rounding);
        // disc = |d|²(r² − s²), s the line's distance from the centre. Where s > 2r its sign is
        // beyond doubt if delta is far below r; else s ≤ 2r.
        let lever =
            if delta.exponent().saturating_add(4) < radius.exponent() { radius } else { radius + times(away, 1) };
        let c_terms = Bound::of(&oc2) + Bound::of(&rr);
        let (disc, disc_terms) = if N < LAST {
            (b * b - a * c, Bound::of(&a) * c_terms)
        } else {
            // Dearer, but what it subtracts is no more than the sphere's size: spheres however small
            // beside their distance are told from points.
            let (arm, reach) = (oc.cross(&ray.d), a * rr);
            let square = arm.dot(&arm);
            (reach - square, Bound::of(&reach) + Bound::of(&square))
        };
        Self {
            disc,
            disc_error: Bound::of(&a) * (times(lever * delta, 3) + times(delta * delta, 2)) + rounding * disc_terms,
            disc_terms,
            b_terms: away * speed,
            b_error: times(speed * (position + away * (times(turn, 2) + rounding)), 2),
            c_error: times(away * position, 3) + times(position * position, 2) + rounding * c_terms,
            c_terms,
            a,
            b,
            c,
            delta,
        }
    }

    /// √disc and its error; both 0 where the line is a tangent.
    pub(super) fn root(&self) -> Result<Option<(Big<N>, Bound)>, Unsure> {
        Ok(match sign(&self.disc, self.disc_terms, self.disc_error)? {
            -1 => None,
            0 => Some((Big::ZERO, Bound::ZERO)),
            _ => {
                let root = self.disc.sqrt();
                Some((root, self.disc_error.over(&root)))
            }
        })
    }

    /// √disc of a line that is known to meet the sphere, and its error.
    pub(super) fn root_of_a_hit(&self) -> (Big<N>, Bound) {
        let root = self.disc.sqrt();
        if self.disc_error == Bound::ZERO {
            return (root, Bound::ZERO);
        }
        // |√a − √b| is at most |a − b|/√a, and √|a − b|.
        let (far, near) = (self.disc_error.over(&root), Bound::power((self.disc_error.exponent() + 3).div_euclid(2)));
        (root, if far.exponent() < near.exponent() { far } else { near })
    }

    /// Where the line enters, or leaves, the sphere: of the two forms of each root, the one that
    /// subtracts nothing.
    pub(super) fn distance(&self, (root, root_error): (Big<N>, Bound), far: bool, rounding: Bound) -> Distance<N> {
        let sum = if self.b.signum() < 0 { root - self.b } else { root + self.b };
        let (b_error, c_error) = (self.b_error + root_error, self.c_error);
        if far == (self.b.signum() < 0) {
            let t = sum.over(self.a);
            let t = if far { t } else { -t };
            return Distance { t, error: b_error.over(&self.a) + rounding * Bound::of(&t) };
        }
        let t = self.c.over(sum);
        let t = if far { -t } else { t };
        let size = Bound::of(&t);
        Distance { t, error: times((c_error + size * b_error).over(&sum), 1) + rounding * size }
    }

    /// Where the line through a point of the sphere meets it again.
    pub(super) fn other(&self, rounding: Bound) -> Distance<N> {
        let t = -self.b.scale(1).over(self.a);
        Distance { t, error: times(self.b_error, 1).over(&self.a) + rounding * Bound::of(&t) }
    }
}
