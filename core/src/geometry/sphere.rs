//! Ray against sphere.
//!
//! The squared distance of the centre from the line is taken from the vector
//! q = oc − (oc·d/d·d)·d rather than from b² − 4ac, which loses everything when the sphere
//! is small and far (Haines, Günther, Akenine-Möller, *Precision improvements for ray/sphere
//! intersection*, Ray Tracing Gems, 2019, ch. 7).
//!
//! **Bound.** With m ≥ |oc|: oc carries `eo`, its own rounding u·m and the centre's, at most
//! u·|c| ≤ u·(m + |o|). s = oc·d/d·d carries at most 9u relative to m/|d|, so that s·d and
//! the subtraction leave q within 12u·m. A direction off by `ed` moves the line by at most
//! 1.01·ed·m at the centre. Together δ = eo + u(4|o|) + m(1.1·ed + 20u), generously, bounds
//! the error of |q| as a distance from the centre.

use glam::DVec3;

use super::{Ray, Span, TINY, U, norm1};

/// A sphere in local space; its centre is within U·|c| of the real one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalSphere {
    pub(crate) c: DVec3,
    pub(crate) r: f64,
}

/// How far the line may be misplaced at the sphere's centre.
fn delta(ray: &Ray, oc: DVec3) -> f64 {
    ray.eo + 4.0 * U * norm1(ray.o) + norm1(oc) * (1.1 * ray.ed + 20.0 * U) + TINY
}

/// Where the ray meets the sphere first.
pub(crate) fn test(ray: &Ray, s: &LocalSphere) -> Option<Span> {
    let oc = ray.o - s.c;
    let mid = -oc.dot(ray.d) / ray.dd;
    let q = oc + ray.d * mid;
    let qq = q.dot(q);
    let d = delta(ray, oc);
    let outer = s.r + d;
    if qq > outer * outer * (1.0 + 8.0 * U) {
        return None;
    }
    let rr = s.r * s.r;
    let hh = rr - qq;
    let dhh = d * (4.0 * s.r + 2.0 * d) + 8.0 * U * rr + TINY;
    let h = hh.max(0.0).sqrt();
    let half = h * ray.inv_len;
    // |h − h*| ≤ min(Δ/h, √Δ) where |h² − h*²| ≤ Δ.
    let dh = (dhh / h).min(dhh.sqrt());
    let e = (d + dh) * ray.inv_len + 32.0 * U * (mid.abs() + half);
    let (near, far) = (mid - half, mid + half);
    let inner = s.r - d;
    let sure = inner > 0.0 && qq < inner * inner * (1.0 - 8.0 * U);
    if !sure {
        return Span::unsure(near - e, far + e, near, false);
    }
    if near - e > 0.0 {
        return Span::around(near, e, false);
    }
    if near + e < 0.0 {
        return Span::around(far, e, true);
    }
    // The start may lie on the sphere: near root, far root or nothing.
    Span::unsure(0.0, far + e, near, near <= 0.0)
}

/// Where a ray that starts on the sphere's inner side meets it again: the other root.
pub(crate) fn test_from_inside(ray: &Ray, s: &LocalSphere) -> Option<Span> {
    let oc = ray.o - s.c;
    let t = -2.0 * oc.dot(ray.d) / ray.dd;
    let e = 3.0 * delta(ray, oc) * ray.inv_len + 32.0 * U * t.abs();
    // The real distance is above 0 whatever the bound says: the ray points inward.
    let lo = (t - e).max(0.0);
    Some(Span { lo, hi: t + e, t, sure: t.is_finite() && e.is_finite(), inside: true })
}

/// The distance along `ray` of the hit already known to be real, with its error bound.
pub(crate) fn distance(ray: &Ray, s: &LocalSphere, inside: bool, from_inside: bool) -> (f64, f64) {
    if from_inside {
        return test_from_inside(ray, s).map_or((f64::NAN, f64::INFINITY), |x| (x.t, (x.hi - x.t).abs()));
    }
    let oc = ray.o - s.c;
    let mid = -oc.dot(ray.d) / ray.dd;
    let q = oc + ray.d * mid;
    let qq = q.dot(q);
    let d = delta(ray, oc);
    let rr = s.r * s.r;
    let dhh = d * (4.0 * s.r + 2.0 * d) + 8.0 * U * rr + TINY;
    let h = (rr - qq).max(0.0).sqrt();
    let half = h * ray.inv_len;
    let dh = (dhh / h).min(dhh.sqrt());
    let e = (d + dh) * ray.inv_len + 32.0 * U * (mid.abs() + half);
    (if inside { mid + half } else { mid - half }, e)
}
