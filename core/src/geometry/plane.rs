//! Ray against infinite plane.
//!
//! **Bound.** The unit normal is within 2u of the real one, the offset h within u·|h|. Then
//! h − n·o is off by at most eo + 6u·|o| + u·|h|, and n·d by at most (ed + 6u)·|d|.

use glam::DVec3;

use super::{Ray, Span, TINY, U, norm1};

/// n · P = h in local space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalPlane {
    pub(crate) n: DVec3,
    pub(crate) h: f64,
}

/// Distance to the plane and its error bound, infinite where the ray may be parallel to it.
pub(crate) fn distance(ray: &Ray, plane: &LocalPlane) -> (f64, f64) {
    let num = plane.h - plane.n.dot(ray.o);
    let den = plane.n.dot(ray.d);
    let dnum = ray.eo + 8.0 * U * (norm1(ray.o) + plane.h.abs()) + TINY;
    let dden = (ray.ed + 8.0 * U) * ray.len + TINY;
    let t = num / den;
    // |num/den − num*/den*| ≤ (Δnum + |t|·Δden) / (|den| − Δden)
    let rest = den.abs() - dden;
    let e = if rest > 0.0 { (dnum + t.abs() * dden) / rest + 8.0 * U * t.abs() } else { f64::INFINITY };
    (t, e)
}

/// Where the ray meets the plane.
pub(crate) fn test(ray: &Ray, plane: &LocalPlane) -> Option<Span> {
    let (t, e) = distance(ray, plane);
    if e < f64::INFINITY {
        return Span::around(t, e, false);
    }
    // Perhaps parallel: not nearer than the least numerator over the greatest denominator allows.
    let num = (plane.h - plane.n.dot(ray.o)).abs() - (ray.eo + 8.0 * U * (norm1(ray.o) + plane.h.abs()) + TINY);
    let den = plane.n.dot(ray.d).abs() + (ray.ed + 8.0 * U) * ray.len + TINY;
    let lo = num / den * (1.0 - 8.0 * U);
    Span::unsure(lo, f64::INFINITY, t, false)
}
