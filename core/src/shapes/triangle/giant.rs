//! Triangles far larger than what is seen of them, described around the eye.
//!
//! The corners of a needle are rounded by more than its width. What matters of such a triangle is near the origin of
//! local space, the eye. There it is n·P = h with linear functions u·P + u0 and v·P + v0 for the weights of its second
//! and third corner. These numbers are found exactly and rounded once each, so that what they misplace is a share of
//! the distance from the eye, and not of the triangle's size.
//!
//! **Bound.** Every number here is within u of itself. The plane is one of [`crate::shapes::plane`]; a point that is
//! off by ep has weights that are off by (|u| + |v|)·ep + 8u((|u| + |v|)|P| + |u0| + |v0| + 1).

use glam::DVec3;

use crate::numeric::{Scalar, TINY, Unsure, V3, Vector};
use crate::scene::Triangle;
use crate::shapes::giants::{LOST, MayBeGiant, WIDE, known, vector};
use crate::shapes::plane::{self, LocalPlane};
use crate::shapes::{Ray, Span};

/// A triangle around the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GiantTriangle<R = f64> {
    pub(crate) plane: LocalPlane<R>,
    pub(crate) u: V3<R>,
    pub(crate) u0: R,
    pub(crate) v: V3<R>,
    pub(crate) v0: R,
}

impl MayBeGiant for Triangle {
    type Giant = GiantTriangle;

    fn giant(&self, eye: DVec3, power: i32) -> Option<GiantTriangle> {
        let [a, b, c] = self.written.map(Vector::<WIDE>::new);
        let (e1, e2) = if self.by_sides() { (b, c) } else { (b - a, c - a) };
        let a = a - Vector::new(eye);
        let (n, power) = (e1.cross(&e2), i64::from(power));
        let nn = n.dot(&n);
        let terms = e1.exponent() + e2.exponent();
        if nn.is_zero() || n.exponent() < terms - LOST {
            return None;
        }
        let unit = n * nn.sqrt().reciprocal();
        let h = unit.dot(&a);
        let h = known(&h, a.exponent()).and_then(|_| known(&h.scale(-power), i64::MIN + LOST))?;
        let (u, v) = (e2.cross(&n) * nn.reciprocal(), n.cross(&e1) * nn.reciprocal());
        // Next to nothing is nothing beside a weight of 1.
        let weight = |u: &Vector<WIDE>| known(&-u.dot(&a), u.exponent() + a.exponent()).unwrap_or(0.0);
        let (u0, v0) = (weight(&u), weight(&v));
        let (u, v) = (vector(&u.scale(power)), vector(&v.scale(power)));
        let sound = u.norm1() + v.norm1() < 1e100 && u0.abs() + v0.abs() < 1e100;
        sound.then(|| GiantTriangle { plane: LocalPlane { n: vector(&unit), h }, u, u0, v, v0 })
    }
}

/// Where the ray surely meets the triangle or surely does not; `Err` where these numbers do not tell.
pub(super) fn test<R: Scalar>(ray: &Ray<R>, tri: &GiantTriangle<R>) -> Result<Option<Span<R>>, Unsure> {
    let k = |x: f64| R::splat(x);
    let (t, et) = plane::distance(ray, &tri.plane);
    if !(et < k(f64::INFINITY)) {
        return Err(Unsure);
    }
    let p = ray.o + ray.d * t;
    let travel = t.abs() * ray.len;
    let ep = et * ray.len + ray.eo + travel * ray.ed + k(8.0 * R::U) * (ray.o.norm1() + travel);
    let (u, v) = (tri.u.dot(p) + tri.u0, tri.v.dot(p) + tri.v0);
    let slope = tri.u.norm1() + tri.v.norm1();
    let terms = slope * p.norm1() + tri.u0.abs() + tri.v0.abs() + k(1.0);
    let e = slope * ep + k(8.0 * R::U) * terms + k(TINY);
    let least = u.min(v).min(k(1.0) - u - v);
    if least < -e {
        return Ok(None);
    }
    let span = Span::around(t, et, false);
    match span {
        Some(span) if span.sure && !(least > e) => Err(Unsure),
        Some(span) if !span.sure => Err(Unsure),
        span => Ok(span),
    }
}
