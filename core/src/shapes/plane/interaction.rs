//! Where a ray meets a plane that it is known to meet.

use super::{LocalPlane, distance};
use crate::numeric::{Real, V3};
use crate::shapes::interaction::{against, point};
use crate::shapes::{Ray, SurfaceInteraction, all_same};
use crate::simd::{F64x8, Simd, three};

#[inline(always)]
pub(crate) fn interaction<R: Real>(ray: &Ray<R>, plane: &LocalPlane<R>) -> SurfaceInteraction<R> {
    let (t, et) = distance(ray, plane);
    let (p, ep) = point(ray, t, et);
    SurfaceInteraction { p, ep, n: against(ray, plane.n), en: R::splat(4.0 * R::U) }
}

/// The planes `ids`, one in each lane.
#[inline(always)]
pub(crate) fn eight<S: Simd>(planes: &[LocalPlane], ids: &[u32; 8]) -> LocalPlane<S::F64x8> {
    if all_same(ids) {
        let p = &planes[ids[0] as usize];
        return LocalPlane { n: V3::splat(p.n.to_dvec3()), h: S::F64x8::splat(p.h) };
    }
    let mut lanes = [[0.0; 8]; 4];
    for k in 0..8 {
        let p = &planes[ids[k] as usize];
        (lanes[0][k], lanes[1][k], lanes[2][k], lanes[3][k]) = (p.n.x, p.n.y, p.n.z, p.h);
    }
    LocalPlane { n: three::<S>(&lanes, 0), h: S::F64x8::load(&lanes[3]) }
}
