//! Triangles far larger than what is seen of them, described around the eye.
//!
//! The corners of a needle are rounded by more than its width. What matters of such a triangle is near the origin of
//! local space, the eye. There it is n·P = h with linear functions u·P + u0 and v·P + v0 for the weights of its second
//! and third corner. These numbers are found exactly and rounded once each, so that what they misplace is a share of
//! the distance from the eye, and not of the triangle's size.
//!
//! **Bound.** Every number here is within u of itself. The plane is one of [`crate::shapes::plane`]; a point that is
//! off by ep has weights that are off by (|u| + |v|)·ep + 8u((|u| + |v|)|P| + |u0| + |v0| + 1).

use crate::numeric::{Real, TINY, V3};
use crate::shapes::plane::{self, LocalPlane};
use crate::shapes::{Ray, Span};

/// A triangle around the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GiantTriangle {
    pub(crate) plane: LocalPlane,
    pub(crate) u: V3<f64>,
    pub(crate) u0: f64,
    pub(crate) v: V3<f64>,
    pub(crate) v0: f64,
}

/// Where the ray surely meets the triangle or surely does not; `Err` where these numbers do not tell.
pub(crate) fn test(ray: &Ray, tri: &GiantTriangle) -> Result<Option<Span>, Unsure> {
    let (t, et) = plane::distance(ray, &tri.plane);
    if !(et < f64::INFINITY) {
        return Err(Unsure);
    }
    let p = ray.o + ray.d * t;
    let travel = t.abs() * ray.len;
    let ep = et * ray.len + ray.eo + travel * ray.ed + 8.0 * f64::U * (ray.o.norm1() + travel);
    let (u, v) = (tri.u.dot(p) + tri.u0, tri.v.dot(p) + tri.v0);
    let slope = tri.u.norm1() + tri.v.norm1();
    let e = slope * ep + 8.0 * f64::U * (slope * p.norm1() + tri.u0.abs() + tri.v0.abs() + 1.0) + TINY;
    let least = u.min(v).min(1.0 - u - v);
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

/// These numbers do not tell.
pub(crate) struct Unsure;
