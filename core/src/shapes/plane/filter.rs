//! A plane before rays in f32.

use super::LocalPlane;
use crate::shapes::filter::{Intersection, Ray, U32, each, single};
use crate::simd::Floats;

/// A plane in f32.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    pub(crate) n: [f32; 3],
    pub(crate) h: f32,
    /// Whether it passes exactly through the eye, from where it is not seen then.
    pub(crate) through_eye: bool,
}

impl Plane {
    pub(crate) fn new(p: &LocalPlane) -> Self {
        Self { n: single(p.n), h: p.h as f32, through_eye: p.h == 0.0 }
    }
}

/// Where rays meet the plane, whose directions are off by `ed`.
#[inline(always)]
pub(crate) fn intersect<F: Floats>(r: &Ray<F>, p: &Plane, ed: F, mask: F::Mask) -> Intersection<F> {
    let s = F::splat;
    let n = each!(k => s(p.n[k]));
    let den = Ray::dot(n, &r.d);
    let num = s(p.h) - Ray::dot(n, &r.o);
    let inv = den.recip();
    let at = num * inv;
    let steep = inv.abs();
    let turn = (ed + s(16.0 * U32)) * r.len * steep;
    let et = (r.near + s(16.0 * U32 * p.h.abs())) * steep + at.abs() * turn;
    let et = et * s(2.0);
    let (lo, hi) = (at - et, at + et);
    let zero = s(0.0);
    // The direction surely leans towards one side of the plane.
    let leans = turn.lt(s(0.25));
    let may = mask & !(leans & hi.lt(zero));
    let sure = leans & zero.lt(lo);
    Intersection {
        may,
        sure,
        lo: lo.select(leans, s(0.0)),
        hi: hi.select(leans, s(f32::INFINITY)),
        inside: F::Mask::from(0),
    }
}
