//! Ray against sphere.
//!
//! The squared distance of the centre from the line is taken from the vector
//! q = oc − (oc·d/d·d)·d rather than from b² − 4ac, which loses everything when the sphere
//! is small and far (Haines, Günther, Akenine-Möller, *Precision improvements for ray/sphere
//! intersection*, Ray Tracing Gems, 2019, ch. 7).
//!
//! **Bound.** With m ≥ |oc|: oc carries `eo`, its own rounding u·m and the centre's, at most
//! u·|c| ≤ u·(m + |o|). A relative error of s = oc·d/d·d, at most 7u, moves q along the line,
//! hence |q| in second order only, and by no more than 7u·m where |q| itself is that small; the
//! product s·d and the sum leave 2u·m. A direction off by `ed` moves the line by at most
//! 1.01·ed·m at the centre. Together δ = eo + 4u·|o| + m(1.1·ed + 10u) bounds the error of |q|.
//! Then h² = r² − |q|² is off by at most δ(2r + 3δ) + 8u·r².

pub(crate) mod beam;
pub(crate) mod bounds;
pub(crate) mod exact;
pub(crate) mod filter;
pub(crate) mod giant;
mod interaction;
mod local;
pub(crate) mod proof;
pub(crate) mod texture;

use giant::GiantSphere;
use glam::DVec3;

pub(crate) use interaction::{eight, interaction};

use super::{Decision, Ray, Span};
use crate::numeric::{Real, Scalar, TINY, V3};

/// A sphere in local space; its centre is within U·|c| of the real one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalSphere<R = f64> {
    pub(crate) c: V3<R>,
    pub(crate) r: R,
}

impl LocalSphere {
    pub(crate) fn center(&self) -> DVec3 {
        self.c.to_dvec3()
    }
}

/// How far the line may be misplaced at the sphere's centre.
#[inline(always)]
fn delta<R: Real>(ray: &Ray<R>, oc: V3<R>) -> R {
    ray.eo
        + R::splat(4.0 * R::U) * ray.o.norm1()
        + oc.norm1() * (R::splat(1.1) * ray.ed + R::splat(10.0 * R::U))
        + R::splat(TINY)
}

/// Both roots, from the middle of the chord, and the bound on their error.
struct Roots<R> {
    near: R,
    far: R,
    e: R,
    /// Squared distance of the centre from the line, and how far the line may be misplaced.
    qq: R,
    delta: R,
}

#[inline(always)]
fn roots<R: Real>(ray: &Ray<R>, s: &LocalSphere<R>) -> Roots<R> {
    let zero = R::splat(0.0);
    let oc = ray.o - s.c;
    let mid = -oc.dot(ray.d) / ray.dd;
    let q = oc + ray.d * mid;
    let qq = q.dot(q);
    let delta = delta(ray, oc);
    let rr = s.r * s.r;
    let dhh = delta * (R::splat(2.0) * s.r + R::splat(3.0) * delta) + R::splat(8.0 * R::U) * rr + R::splat(TINY);
    let h = (rr - qq).max(zero).sqrt();
    let half = h * ray.inv_len;
    // Where |h² − h*²| ≤ Δ, |h − h*| ≤ √Δ, and for x = Δ/h² ≤ 1, |h − h*| ≤ h(1 − √(1 − x)) ≤
    // h(x + x²)/2, which is more than √Δ for x > 1.
    let hx = dhh / h;
    let dh = (hx * (R::splat(0.5 + 1e-9) + R::splat(0.5) * (hx / h))).min(dhh.sqrt());
    let e = (delta + dh) * ray.inv_len + R::splat(32.0 * R::U) * (mid.abs() + half);
    Roots { near: mid - half, far: mid + half, e, qq, delta }
}

/// Where a ray that starts on the sphere's inner side meets it again, the other root, and its bound.
#[inline(always)]
pub(crate) fn other_root<R: Real>(ray: &Ray<R>, s: &LocalSphere<R>) -> (R, R) {
    let oc = ray.o - s.c;
    let t = R::splat(-2.0) * oc.dot(ray.d) / ray.dd;
    let e = R::splat(3.0) * delta(ray, oc) * ray.inv_len + R::splat(32.0 * R::U) * t.abs();
    (t, e)
}

/// Where `ray`, which starts on the sphere as `own` says, if it does, meets it first; `around_eye` is the sphere again,
/// if it is a giant.
pub(crate) fn test<R: Scalar>(
    ray: &Ray<R>,
    s: &LocalSphere<R>,
    around_eye: Option<&GiantSphere<R>>,
    own: Option<Decision>,
) -> Option<Span<R>> {
    match (own, around_eye) {
        (Some(own), _) if !own.inside => None,
        (Some(_), Some(giant)) => giant::test_from_inside(ray, giant),
        (Some(_), None) => test_from_inside(ray, s),
        (None, Some(giant)) => {
            giant::test(ray, giant).and_then(|span| if span.sure { Some(span) } else { test_from_elsewhere(ray, s) })
        }
        (None, None) => test_from_elsewhere(ray, s),
    }
}

/// Where a ray that starts elsewhere meets the sphere first.
fn test_from_elsewhere<R: Scalar>(ray: &Ray<R>, s: &LocalSphere<R>) -> Option<Span<R>> {
    let k = |x: f64| R::splat(x);
    let zero = k(0.0);
    let Roots { near, far, e, qq, delta } = roots(ray, s);
    let outer = s.r + delta;
    if qq > outer * outer * k(1.0 + 8.0 * R::U) + k(TINY) {
        return None;
    }
    let inner = s.r - delta;
    let sure = inner > zero && qq + k(TINY) < inner * inner * k(1.0 - 8.0 * R::U);
    if !sure {
        return Span::unsure(near - e, far + e, false);
    }
    if near - e > zero {
        return Span::around(near, e, false);
    }
    if near + e < zero {
        return Span::around(far, e, true);
    }
    // The start may lie on the sphere: near root, far root or nothing.
    Span::unsure(zero, far + e, near <= zero)
}

/// Where a ray that starts on the sphere's inner side meets it again.
fn test_from_inside<R: Scalar>(ray: &Ray<R>, s: &LocalSphere<R>) -> Option<Span<R>> {
    let (t, e) = other_root(ray, s);
    // The real distance is above 0 whatever the bound says: the ray points inward.
    let (lo, hi) = ((t - e).max(R::splat(0.0)), t + e);
    Some(Span { lo, hi, sure: hi.to_f64().is_finite(), inside: true })
}

/// The two distances at which the line is known to meet the sphere, and their error bound.
#[inline(always)]
pub(crate) fn distances<R: Real>(ray: &Ray<R>, s: &LocalSphere<R>) -> (R, R, R) {
    let r = roots(ray, s);
    (r.near, r.far, r.e)
}
