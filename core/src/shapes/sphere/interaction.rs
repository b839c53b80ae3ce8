//! Where a ray meets a sphere that it is known to meet.

use super::giant::{self, GiantSphere};
use super::{LocalSphere, distances, other_root};
use crate::numeric::{Real, V3};
use crate::shapes::interaction::point;
use crate::shapes::{Ray, SurfaceInteraction};
use crate::simd::{F64x8, Simd, three};

/// `inner` > 0 where the inner side is struck, `own` > 0 where the ray starts on this sphere; `around_eye` is the sphere
/// again, if it is a giant.
#[inline(always)]
pub(crate) fn interaction<R: Real>(
    ray: &Ray<R>,
    s: &LocalSphere<R>,
    around_eye: Option<&GiantSphere<R>>,
    inner: R,
    own: R,
) -> SurfaceInteraction<R> {
    let found = by_center(ray, s, inner, own);
    match around_eye {
        Some(giant) => SurfaceInteraction::better(by_eye(ray, giant, inner, own), found),
        None => found,
    }
}

#[inline(always)]
fn by_center<R: Real>(ray: &Ray<R>, s: &LocalSphere<R>, inner: R, own: R) -> SurfaceInteraction<R> {
    let (near, far, e) = distances(ray, s);
    let (other, e_other) = other_root(ray, s);
    let t = own.if_positive(other, inner.if_positive(far, near));
    let (p, ep) = point(ray, t, own.if_positive(e_other, e));
    let n = (p - s.c) * (R::splat(1.0) / s.r);
    let en = (ep + R::splat(2.0 * R::U) * s.c.norm1()) / s.r + R::splat(8.0 * R::U);
    SurfaceInteraction { p, ep, n: V3::if_positive(inner, -n, n), en }
}

/// The same on a sphere described around the eye.
#[inline(always)]
fn by_eye<R: Real>(ray: &Ray<R>, s: &GiantSphere<R>, inner: R, own: R) -> SurfaceInteraction<R> {
    let (t, et) = giant::distance(ray, s, inner, own);
    let (p, ep) = point(ray, t, et);
    let (n, en) = giant::normal(s, p, ep);
    SurfaceInteraction { p, ep, n: V3::if_positive(inner, -n, n), en }
}

/// The spheres `ids`, one in each lane; the first has the id `first`.
#[inline(always)]
pub(crate) fn eight<S: Simd>(spheres: &[LocalSphere], ids: &[u32; 8], first: u32) -> LocalSphere<S::F64x8> {
    let mut lanes = [[0.0; 8]; 4];
    for k in 0..8 {
        let s = &spheres[ids[k] as usize - first as usize];
        (lanes[0][k], lanes[1][k], lanes[2][k], lanes[3][k]) = (s.c.x, s.c.y, s.c.z, s.r);
    }
    LocalSphere { c: three::<S>(&lanes, 0), r: S::F64x8::load(&lanes[3]) }
}
