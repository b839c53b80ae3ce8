//! Ray against triangle.
//!
//! Membership by the edges' Plücker forms e·(d, moment), as U = d · ((p2 − p0) × (p2 + p0))
//! with corners p relative to the start: the error is that of the corners' places, not that of
//! their moments. A line through an edge has all three corners' forms from the same three
//! points, so that where signs are sure, neighbours agree; where they are not, real
//! arithmetic decides.
//!
//! **Bound.** A corner is misplaced, relative to the ray at its distance, by at most
//! pos = eo + 3u(V + |o|) + (ed + 12u)·M, where V and M bound the corners' distances from the
//! origin and from the start. A form is |d|·|e|·2·(distance from the edge), so that near the
//! triangle (lateral distance at most its longest edge S plus pos) it is off by at most
//! 8·|d|·pos·(S + pos). Farther away any outcome but a sure hit is right, and a sure hit cannot
//! come out, since the computed triangle is a real triangle within pos.
//!
//! The distance is the plane's, T = N·p0 over N·d. A rounded N misplaces the plane by at most
//! 6u·S³/|N| inside the triangle, the corners by 2·pos, so that t is off by at most
//! (3·pos·|N| + 12u·S³)/|N·d|.

pub(crate) mod beam;
pub(crate) mod bounds;
pub(crate) mod coplanar;
pub(crate) mod exact;
pub(crate) mod filter;
pub(crate) mod giant;
mod local;
pub(crate) mod proof;
pub(crate) mod texture;

use giant::GiantTriangle;
use glam::DVec3;

use super::beam::Figure;
use super::coplanar::FlatObject;
use super::interaction::{against, lanes, point};
use super::plane::LocalPlane;
use super::{Decision, LEAST_SQUARE, Local, Ray, Shape, Span, SurfaceInteraction, giants};
use crate::numeric::{DoubleDouble, Real, Scalar, TINY, V3};
use crate::scene::{Order, Plane, Scene, SurfaceId, Triangle};
use crate::simd::Simd;

/// Corners in local space, each within 2u·V of the real ones.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalTriangle<R = f64> {
    pub(crate) v: [V3<R>; 3],
}

impl LocalTriangle {
    pub(crate) fn corners(&self) -> [DVec3; 3] {
        self.v.map(|v| v.to_dvec3())
    }
}

/// All that a test and a shading point need of one ray and one triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Forms<R> {
    /// Edge forms opposite c1, c2 and c0: weights of those corners.
    pub(crate) w: [R; 3],
    /// Their common error bound.
    pub(crate) e: R,
    /// N = (c1 − c0) × (c2 − c0).
    pub(crate) n: V3<R>,
    /// Distance to the plane and its error bound.
    pub(crate) t: R,
    pub(crate) et: R,
    /// How far a corner may be misplaced.
    pos: R,
    /// How far a corner may be from the scene's, and the longest edge.
    pub(crate) corner_error: R,
    pub(crate) longest: R,
    p: [V3<R>; 3],
    reach: R,
}

#[inline(always)]
fn max3<R: Real>(a: R, b: R, c: R) -> R {
    a.max(b).max(c)
}

#[inline(always)]
pub(crate) fn forms<R: Real>(ray: &Ray<R>, tri: &LocalTriangle<R>) -> Forms<R> {
    let k = |x: f64| R::splat(x);
    let [v0, v1, v2] = tri.v;
    let (p0, p1, p2) = (v0 - ray.o, v1 - ray.o, v2 - ray.o);
    let (e0, e1, e2) = (p2 - p0, p0 - p1, p1 - p2);
    let w = [e0.cross(p2 + p0).dot(ray.d), e1.cross(p0 + p1).dot(ray.d), e2.cross(p1 + p2).dot(ray.d)];
    let m = max3(p0.norm1(), p1.norm1(), p2.norm1());
    let v = max3(v0.norm1(), v1.norm1(), v2.norm1());
    let s = max3(e0.norm1(), e1.norm1(), e2.norm1());
    let pos = ray.eo + k(3.0 * R::U) * (v + ray.o.norm1()) + (ray.ed + k(12.0 * R::U)) * m + k(TINY);
    let e = k(8.0) * ray.len * pos * (s + pos) + k(TINY);
    let n = e0.cross(e1);
    let den = n.dot(ray.d);
    let t = n.dot(p0) / den;
    let et = (k(3.0) * pos * n.norm1() + k(12.0 * R::U) * s * s * s + k(TINY)) / den.abs();
    let corner_error = k(3.0 * R::U) * v + k(TINY);
    Forms { w, e, n, t, et, pos, corner_error, longest: s, p: [p0, p1, p2], reach: m }
}

/// Where the ray meets the triangle.
fn test<R: Scalar>(ray: &Ray<R>, tri: &LocalTriangle<R>) -> Option<Span<R>> {
    let f = forms(ray, tri);
    let (lo, hi) = (f.w[0].min(f.w[1]).min(f.w[2]), f.w[0].max(f.w[1]).max(f.w[2]));
    if lo < -f.e && hi > f.e {
        return None;
    }
    if lo > f.e || hi < -f.e {
        let s = Span::around(f.t, f.et, false)?;
        if s.sure {
            return Some(s);
        }
    }
    // Whatever is met lies between the nearest and the farthest corner.
    let along = f.p.map(|p| p.dot(ray.d) / ray.dd);
    let e = (f.pos + R::splat(8.0 * R::U) * f.reach) * ray.inv_len;
    let near = along[0].min(along[1]).min(along[2]) - e;
    let far = along[0].max(along[1]).max(along[2]) + e;
    Span::unsure(near, far, false)
}

impl Shape for Triangle {
    const HAS_INSIDE: bool = false;
    type Local<R: Real> = (LocalTriangle<R>, Option<GiantTriangle<R>>);

    fn surface_and_order(&self) -> (SurfaceId, Order) {
        (self.surface(), self.order)
    }

    fn local(&self, i: usize, local: &Local) -> Self::Local<f64> {
        (local.triangle(self), giants::find(&local.giants.triangles, i).copied())
    }

    /// To twice the digits, corners do.
    fn double(&self, _: usize, local: &Local) -> Self::Local<DoubleDouble> {
        (LocalTriangle::double(self, local), None)
    }

    #[inline(always)]
    fn eight<S: Simd>(scene: &Scene, local: &Local, places: &[usize; 8]) -> Self::Local<S::F64x8> {
        let numbers = |i: usize| {
            let [a, b, c] = local.triangle(&scene.triangles()[i]).v;
            [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z]
        };
        let [ax, ay, az, bx, by, bz, cx, cy, cz] = lanes::<S, 9>(places, numbers);
        let v = [V3 { x: ax, y: ay, z: az }, V3 { x: bx, y: by, z: bz }, V3 { x: cx, y: cy, z: cz }];
        // Of giants, only the plane matters where they are known to be met.
        let plane = |t: &GiantTriangle| [t.plane.n.x, t.plane.n.y, t.plane.n.z, t.plane.h];
        let plane = giants::eight::<S, _, 4>(&local.giants.triangles, places, plane);
        let (zero, none) = (S::F64x8::splat(0.0), V3::splat(DVec3::ZERO));
        let around = |plane| GiantTriangle { plane, u: none, u0: zero, v: none, v0: zero };
        (LocalTriangle { v }, plane.map(|[x, y, z, h]| around(LocalPlane { n: V3 { x, y, z }, h })))
    }

    fn test<R: Scalar>(ray: &Ray<R>, (t, giant): &Self::Local<R>, _: Option<Decision>) -> Option<Span<R>> {
        giant.as_ref().and_then(|giant| giant::test(ray, giant).ok()).unwrap_or_else(|| test(ray, t))
    }

    #[inline(always)]
    fn interaction<R: Real>(ray: &Ray<R>, (t, giant): &Self::Local<R>, inner: R, own: R) -> SurfaceInteraction<R> {
        let f = forms(ray, t);
        let nn = f.n.dot(f.n);
        let length = nn.sqrt();
        let (p, ep) = point(ray, f.t, f.et);
        // A corner moved turns the normal by as much over the triangle's height.
        let en = (f.corner_error * f.longest * R::splat(4.0) + R::splat(16.0 * R::U) * f.longest * f.longest) / length;
        // A square that is next to nothing has lost its digits.
        let en = (nn - R::splat(LEAST_SQUARE)).if_positive(en, R::splat(f64::INFINITY));
        let found = SurfaceInteraction { p, ep, n: against(ray, f.n * (R::splat(1.0) / length)), en };
        match giant {
            Some(giant) => SurfaceInteraction::better(Plane::interaction(ray, &giant.plane, inner, own), found),
            None => found,
        }
    }

    #[inline(always)]
    fn figure(&self, _: usize, local: &Local) -> Figure {
        Figure::Triangle(local.triangle(self).corners())
    }

    fn in_plane<'a>(&'a self, _: usize, _: &'a Local) -> Option<FlatObject<'a>> {
        Some(FlatObject::Triangle(self))
    }
}
