//! A triangle before rays in f32.
//!
//! **Bound.** Of triangles around the eye as in [`super::giant`], with u = 2⁻²⁴ and one rounding more of every
//! number; `near` is at least eo + 12u·|o|.

use super::giant::GiantTriangle;
use crate::numeric::{U, V3};
use crate::scene::Triangle;
use crate::shapes::filter::{InLeaves, Intersection, Numbers, Ray, U32, each, is_normal, norm1, single};
use crate::shapes::{Local, plane};
use crate::simd::Floats;

/// Numbers of a triangle, as linear functions of a point P: the unit normal n and n · c0; u and u0,
/// v and v0, where u · P + u0 is the weight of c1 and v · P + v0 that of c2; |u| + |v|, how fast the
/// weights change with the point, infinite where f32 cannot hold them; a bound on the corners'
/// distances from the origin; a number for the id, not a tiny one, for it is read with others.
pub(crate) const NUMBERS: usize = 15;

/// A quarter of what f32 rounds by.
const SINGLE: f64 = U32 as f64 / 4.0;

/// What corners may be misplaced by, and products of sides rounded by, as shares of the greatest of each.
const ROUNDED: f64 = 32.0 * U;

/// One triangle in all lanes, or one in each.
pub(crate) struct Lanes<F> {
    n: [F; 3],
    h: F,
    u: [F; 3],
    u0: F,
    v: [F; 3],
    v0: F,
    slope: F,
    reach: F,
}

/// A triangle around the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Giant {
    pub(crate) plane: plane::filter::Plane,
    pub(crate) u: [f32; 3],
    pub(crate) u0: f32,
    pub(crate) v: [f32; 3],
    pub(crate) v0: f32,
    /// |u| + |v|.
    pub(crate) slope: f32,
    /// |u0| + |v0| + 1, rounded up.
    pub(crate) terms: f32,
}

impl InLeaves<NUMBERS> for Triangle {
    type Lanes<F: Floats> = Lanes<F>;
    type Giant32 = Giant;

    /// No ray meets it, but for one square to the normal, which leaves it in doubt.
    const NEVER: [f32; NUMBERS] = [0.61, 0.37, 0.7, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, f32::NAN];

    fn row(&self, _: usize, local: &Local, id: f32) -> [f32; NUMBERS] {
        let corners = local.triangle(self).v;
        let [a, b, c] = corners;
        let (e1, e2) = (b - a, c - a);
        let n = e1.cross(e2);
        let nn = n.dot(n);
        let unit = n * (1.0 / nn.sqrt());
        let u = e2.cross(n) * (1.0 / nn);
        let v = n.cross(e1) * (1.0 / nn);
        let length = |v: V3<f64>| v.dot(v).sqrt();
        let slope = ((length(u) + length(v)) * (1.0 + 1e-6)) as f32;
        let reach = (corners.into_iter().map(length).fold(0.0, f64::max) * (1.0 + 1e-6)) as f32;
        // The normal of a needle has lost what its sides have in common.
        let side = e1.norm1() + e2.norm1();
        let lost = ROUNDED * side * (side + a.norm1());
        let sound = slope < 1e25 && unit.norm1() > 0.5 && lost < SINGLE * nn.sqrt();
        if !sound {
            // No weight of it is sure or misses: such a triangle is always asked about in f64.
            return [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, f32::INFINITY, reach, id];
        }
        let [n, u, v] = [(unit, unit.dot(a)), (u, -u.dot(a)), (v, -v.dot(a))].map(|(v, x)| (single(v), x as f32));
        let row = |([x, y, z], w): ([f32; 3], f32)| [x, y, z, w];
        let [[n0, n1, n2, h], [u1, u2, u3, u0], [v1, v2, v3, v0]] = [n, u, v].map(row);
        [n0, n1, n2, h, u1, u2, u3, u0, v1, v2, v3, v0, slope, reach, id]
    }

    #[inline(always)]
    fn load<F: Floats>(numbers: &impl Numbers<F>) -> Lanes<F> {
        let [n, u, v] = each!(i => each!(k => numbers.number(4 * i + k)));
        let [h, u0, v0] = each!(i => numbers.number(3 + 4 * i));
        Lanes { n, h, u, u0, v, v0, slope: numbers.number(12), reach: numbers.number(13) }
    }

    #[inline(always)]
    fn intersect<F: Floats>(r: &Ray<F>, t: &Lanes<F>, mask: F::Mask) -> Intersection<F> {
        let s = F::splat;
        let den = Ray::dot(t.n, &r.d);
        let num = t.h - Ray::dot(t.n, &r.o);
        let inv = den.recip();
        let at = num * inv;
        let p = each!(k => r.d[k].fma(at, r.o[k]));
        let u = Ray::dot(t.u, &p) + t.u0;
        let v = Ray::dot(t.v, &p) + t.v0;
        let steep = inv.abs();
        let pos = r.pos(t.reach);
        let e = t.slope * pos * r.len.fma(steep, s(1.2));
        let w = s(1.0) - u - v;
        let least = u.min(v).min(w);
        let et = s(1.2) * pos * steep;
        let (lo, hi) = (at - et, at + et);
        let zero = s(0.0);
        // Written so that NaN may be met and is never sure.
        let may = mask & !least.lt(-e) & !hi.lt(zero);
        let sure = e.lt(least) & zero.lt(lo);
        Intersection { may, sure, lo, hi, inside: F::Mask::from(0) }
    }

    fn single(t: &GiantTriangle) -> Option<Giant> {
        let plane = plane::filter::Plane { n: single(t.plane.n), h: t.plane.h as f32, through_eye: false };
        let slope = ((t.u.norm1() + t.v.norm1()) * (1.0 + 1e-6)) as f32;
        let terms = ((t.u0.abs() + t.v0.abs() + 1.0) * (1.0 + 1e-6)) as f32;
        let giant = Giant { plane, u: single(t.u), u0: t.u0 as f32, v: single(t.v), v0: t.v0 as f32, slope, terms };
        (is_normal(giant.plane.h) && slope < 1e25 && terms < 1e25).then_some(giant)
    }

    #[inline(always)]
    fn intersect_giant<F: Floats>(r: &Ray<F>, t: &Giant, ed: F, mask: F::Mask) -> Intersection<F> {
        let s = F::splat;
        let m = plane::filter::intersect(r, &t.plane, ed, mask);
        let (half, zero) = (s(0.5), s(0.0));
        let (at, et) = ((m.lo + m.hi) * half, (m.hi - m.lo) * half);
        let p = [r.d[0].fma(at, r.o[0]), r.d[1].fma(at, r.o[1]), r.d[2].fma(at, r.o[2])];
        let travel = at.abs() * r.len;
        let ep = et * r.len + r.near + travel * (ed + s(16.0 * U32));
        let weight = |u: &[f32; 3], u0: f32| p[0].fma(s(u[0]), p[1].fma(s(u[1]), p[2] * s(u[2]))) + s(u0);
        let (u, v) = (weight(&t.u, t.u0), weight(&t.v, t.v0));
        let far = norm1(&r.o) + travel;
        let e = s(1.1) * s(t.slope) * (ep + s(16.0 * U32) * far) + s(16.0 * U32) * s(t.terms);
        let least = u.min(v).min(s(1.0) - u - v);
        // Where the plane may be met anywhere, so may the triangle; NaN may be met and is never sure.
        let leans = m.hi.lt(s(f32::INFINITY));
        let may = m.may & !(leans & least.lt(-e));
        let sure = m.sure & leans & e.lt(least) & zero.lt(m.lo);
        Intersection { may, sure, ..m }
    }
}
