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
pub(crate) mod proof;
pub(crate) mod texture;

use giant::GiantSphere;
use glam::DVec3;

use super::beam::Figure;
use super::interaction::{lanes, point};
use super::local::ldexp;
use super::{Decision, Local, Ray, Shape, Span, SurfaceInteraction, giants};
use crate::numeric::{DoubleDouble, Real, Scalar, TINY, V3};
use crate::scene::{Order, Scene, Sphere, SurfaceId};
use crate::simd::Simd;

/// A sphere in local space; its centre is within U·|c| of the real one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalSphere<R = f64> {
    pub(crate) c: V3<R>,
    pub(crate) r: R,
}

impl LocalSphere {
    pub(super) fn new(s: &Sphere, local: &Local) -> Self {
        Self { c: V3::splat(local.point(s.center)), r: ldexp(s.radius, -local.power) }
    }

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
fn other_root<R: Real>(ray: &Ray<R>, s: &LocalSphere<R>) -> (R, R) {
    let oc = ray.o - s.c;
    let t = R::splat(-2.0) * oc.dot(ray.d) / ray.dd;
    let e = R::splat(3.0) * delta(ray, oc) * ray.inv_len + R::splat(32.0 * R::U) * t.abs();
    (t, e)
}

/// Where a ray that starts elsewhere meets the sphere first.
fn test<R: Scalar>(ray: &Ray<R>, s: &LocalSphere<R>) -> Option<Span<R>> {
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

impl Shape for Sphere {
    const HAS_INSIDE: bool = true;
    type Local<R: Real> = (LocalSphere<R>, Option<GiantSphere<R>>);

    fn surface_and_order(&self) -> (SurfaceId, Order) {
        (self.surface, self.order)
    }

    fn local(&self, i: usize, local: &Local) -> Self::Local<f64> {
        (local.spheres[i], giants::find(&local.giants.spheres, i).map(|(giant, _)| *giant))
    }

    fn double(&self, i: usize, local: &Local) -> Self::Local<DoubleDouble> {
        // The radius is exact in f64.
        let sphere = LocalSphere { c: local.double_point(self.center), r: DoubleDouble::splat(local.spheres[i].r) };
        (sphere, giants::find(&local.giants.spheres, i).map(|(_, giant)| *giant))
    }

    #[inline(always)]
    fn eight<S: Simd>(_: &Scene, local: &Local, places: &[usize; 8]) -> Self::Local<S::F64x8> {
        let numbers = |i: usize| {
            let LocalSphere { c, r } = &local.spheres[i];
            [c.x, c.y, c.z, *r]
        };
        let [x, y, z, r] = lanes::<S, 4>(places, numbers);
        let giants = giants::eight::<S, _, 5>(&local.giants.spheres, places, |(s, _)| [s.m.x, s.m.y, s.m.z, s.q, s.k]);
        let giant = giants.map(|[x, y, z, q, k]| GiantSphere { m: V3 { x, y, z }, q, k });
        (LocalSphere { c: V3 { x, y, z }, r }, giant)
    }

    fn test<R: Scalar>(ray: &Ray<R>, (s, giant): &Self::Local<R>, own: Option<Decision>) -> Option<Span<R>> {
        match (own, giant) {
            (Some(own), _) if !own.inside => None,
            (Some(_), Some(giant)) => giant::test_from_inside(ray, giant),
            (Some(_), None) => test_from_inside(ray, s),
            (None, Some(giant)) => {
                giant::test(ray, giant).and_then(|span| if span.sure { Some(span) } else { test(ray, s) })
            }
            (None, None) => test(ray, s),
        }
    }

    #[inline(always)]
    fn interaction<R: Real>(ray: &Ray<R>, (s, giant): &Self::Local<R>, inner: R, own: R) -> SurfaceInteraction<R> {
        let Roots { near, far, e, .. } = roots(ray, s);
        let (other, e_other) = other_root(ray, s);
        let t = own.if_positive(other, inner.if_positive(far, near));
        let (p, ep) = point(ray, t, own.if_positive(e_other, e));
        let n = (p - s.c) * (R::splat(1.0) / s.r);
        let en = (ep + R::splat(2.0 * R::U) * s.c.norm1()) / s.r + R::splat(8.0 * R::U);
        let found = SurfaceInteraction { p, ep, n: V3::if_positive(inner, -n, n), en };
        match giant {
            Some(giant) => SurfaceInteraction::better(giant::interaction(ray, giant, inner, own), found),
            None => found,
        }
    }

    #[inline(always)]
    fn figure(&self, i: usize, local: &Local) -> Figure {
        Figure::Ball(local.spheres[i])
    }
}
