//! Where a ray meets a triangle that it is known to meet.

use super::{LocalTriangle, forms};
use crate::numeric::Real;
use crate::scene::Triangle;
use crate::shapes::interaction::{against, point};
use crate::shapes::{LEAST_SQUARE, Local, Ray, SurfaceInteraction};
use crate::simd::{Simd, three};

#[inline(always)]
pub(crate) fn interaction<R: Real>(ray: &Ray<R>, tri: &LocalTriangle<R>) -> SurfaceInteraction<R> {
    let f = forms(ray, tri);
    let nn = f.n.dot(f.n);
    let length = nn.sqrt();
    let (p, ep) = point(ray, f.t, f.et);
    // A corner moved turns the normal by as much over the triangle's height.
    let en = (f.corner_error * f.longest * R::splat(4.0) + R::splat(16.0 * R::U) * f.longest * f.longest) / length;
    // A square that is next to nothing has lost its digits.
    let en = (nn - R::splat(LEAST_SQUARE)).if_positive(en, R::splat(f64::INFINITY));
    SurfaceInteraction { p, ep, n: against(ray, f.n * (R::splat(1.0) / length)), en }
}

/// The triangles `ids`, one in each lane; the first has the id `first`.
#[inline(always)]
pub(crate) fn eight<S: Simd>(
    local: &Local,
    triangles: &[Triangle],
    ids: &[u32; 8],
    first: u32,
) -> LocalTriangle<S::F64x8> {
    let mut lanes = [[0.0; 8]; 9];
    for k in 0..8 {
        let t = local.triangle(&triangles[ids[k] as usize - first as usize]);
        for (c, v) in t.v.iter().enumerate() {
            (lanes[3 * c][k], lanes[3 * c + 1][k], lanes[3 * c + 2][k]) = (v.x, v.y, v.z);
        }
    }
    LocalTriangle { v: [three::<S>(&lanes, 0), three::<S>(&lanes, 3), three::<S>(&lanes, 6)] }
}
