//! Ray against infinite plane.
//!
//! **Bound.** The unit normal is within 2u of the real one, the offset h within u·|h|; it is 0 where the plane
//! passes through the origin, the eye, and only there. Then
//! h − n·o is off by at most eo + 6u·|o| + u·|h|, and n·d by at most (ed + 6u)·|d|.

pub(crate) mod beam;
pub(crate) mod bounds;
pub(crate) mod coplanar;
pub(crate) mod exact;
pub(crate) mod filter;
mod local;
pub(crate) mod proof;
pub(crate) mod texture;

use super::beam::Figure;
use super::coplanar::FlatObject;
use super::interaction::{against, lanes, point};
use super::{Decision, Local, Ray, Shape, Span, SurfaceInteraction, all_same};
use crate::numeric::{DoubleDouble, Real, Scalar, TINY, V3};
use crate::scene::{Order, Plane, Scene, SurfaceId};
use crate::simd::Simd;

/// n · P = h in local space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalPlane<R = f64> {
    pub(crate) n: V3<R>,
    pub(crate) h: R,
}

/// Distance to the plane and its error bound, infinite or NaN where the ray may be parallel to it.
#[inline(always)]
pub(crate) fn distance<R: Real>(ray: &Ray<R>, plane: &LocalPlane<R>) -> (R, R) {
    let k = |x: f64| R::splat(x);
    let num = plane.h - plane.n.dot(ray.o);
    let den = plane.n.dot(ray.d);
    let dnum = ray.eo + k(8.0 * R::U) * (ray.o.norm1() + plane.h.abs()) + k(TINY);
    let dden = (ray.ed + k(8.0 * R::U)) * ray.len + k(TINY);
    let t = num / den;
    // |num/den − num*/den*| ≤ (Δnum + |t|·Δden) / (|den| − Δden)
    let rest = (den.abs() - dden).max(k(0.0));
    (t, (dnum + t.abs() * dden) / rest + k(8.0 * R::U) * t.abs())
}

impl Shape for Plane {
    const HAS_INSIDE: bool = false;
    type Local<R: Real> = LocalPlane<R>;

    fn surface_and_order(&self) -> (SurfaceId, Order) {
        (self.surface, self.order)
    }

    fn local(&self, i: usize, local: &Local) -> LocalPlane {
        local.planes[i]
    }

    fn double(&self, i: usize, local: &Local) -> LocalPlane<DoubleDouble> {
        local.double_planes[i]
    }

    #[inline(always)]
    fn eight<S: Simd>(_: &Scene, local: &Local, places: &[usize; 8]) -> LocalPlane<S::F64x8> {
        if all_same(places) {
            let p = &local.planes[places[0]];
            return LocalPlane { n: V3::splat(p.n.to_dvec3()), h: S::F64x8::splat(p.h) };
        }
        let numbers = |i: usize| [local.planes[i].n.x, local.planes[i].n.y, local.planes[i].n.z, local.planes[i].h];
        let [x, y, z, h] = lanes::<S, 4>(places, numbers);
        LocalPlane { n: V3 { x, y, z }, h }
    }

    fn test<R: Scalar>(ray: &Ray<R>, plane: &LocalPlane<R>, _: Option<Decision>) -> Option<Span<R>> {
        // From the eye, which is the origin, a plane through the eye is met at 0 alone, or nowhere.
        if plane.h.to_f64() == 0.0 && ray.starts_at_origin() {
            return None;
        }
        let k = |x: f64| R::splat(x);
        let (t, e) = distance(ray, plane);
        if e < k(f64::INFINITY) {
            return Span::around(t, e, false);
        }
        // Perhaps parallel: not nearer than the least numerator over the greatest denominator allows.
        let dnum = ray.eo + k(8.0 * R::U) * (ray.o.norm1() + plane.h.abs()) + k(TINY);
        let num = (plane.h - plane.n.dot(ray.o)).abs() - dnum;
        let den = plane.n.dot(ray.d).abs() + (ray.ed + k(8.0 * R::U)) * ray.len + k(TINY);
        Span::unsure(num / den * k(1.0 - 8.0 * R::U), k(f64::INFINITY), false)
    }

    #[inline(always)]
    fn interaction<R: Real>(ray: &Ray<R>, plane: &LocalPlane<R>, _: R, _: R) -> SurfaceInteraction<R> {
        let (t, et) = distance(ray, plane);
        let (p, ep) = point(ray, t, et);
        SurfaceInteraction { p, ep, n: against(ray, plane.n), en: R::splat(4.0 * R::U) }
    }

    #[inline(always)]
    fn figure(&self, i: usize, local: &Local) -> Figure {
        Figure::Plane(local.planes[i])
    }

    fn in_plane<'a>(&'a self, i: usize, local: &'a Local) -> Option<FlatObject<'a>> {
        Some(FlatObject::Plane(self, &local.planes[i]))
    }
}
