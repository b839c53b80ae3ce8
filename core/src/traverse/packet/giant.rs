//! Objects described around the eye before sixteen rays: see `shapes::sphere::giant` for what is computed.
//!
//! **Bound.** As there, with u = 2⁻²⁴ and one rounding more of every number; `near` is at least eo + 12u·|o|.

use super::U32;
use super::intersect::{Intersection, Ray, intersect_plane};
use crate::simd::Floats;
use crate::traverse::filter::{FlatSphere, FlatTriangle};

/// The greatest error of a direction that bounds here allow for.
const TURNED: f32 = 0.05;

#[inline(always)]
fn norm1<F: Floats>(v: &[F; 3]) -> F {
    v[0].abs() + v[1].abs() + v[2].abs()
}

#[inline(always)]
pub(super) fn intersect_giant_triangle<F: Floats>(
    r: &Ray<F>,
    t: &FlatTriangle,
    ed: F,
    mask: F::Mask,
) -> Intersection<F> {
    let s = F::splat;
    let m = intersect_plane(r, &t.plane, ed, mask);
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

#[inline(always)]
pub(super) fn intersect_giant_sphere<F: Floats>(r: &Ray<F>, g: &FlatSphere, ed: F, mask: F::Mask) -> Intersection<F> {
    let s = F::splat;
    let (zero, u) = (s(0.0), s(U32));
    let m = [s(g.m[0]), s(g.m[1]), s(g.m[2])];
    let (q, twice, size) = (s(g.q), s(2.0 * g.q), s((g.m[0].abs() + g.m[1].abs() + g.m[2].abs()) * 1.000_001));
    let far = norm1(&r.o);
    let steep = size + twice * (far + r.near);
    let gradient = [r.o[0].fma(twice, m[0]), r.o[1].fma(twice, m[1]), r.o[2].fma(twice, m[2])];
    let c = Ray::dot(r.o, &r.o) * q + Ray::dot(r.o, &m) + s(g.k);
    let ec = r.near * steep + s(16.0) * u * (far * (far * q + size) + s(g.k.abs())) + s(1e-35);
    let b = Ray::dot(r.d, &gradient) * s(0.5);
    let eb = r.len * ((ed + s(14.0) * u) * steep + twice * r.near) * s(0.55) + s(1e-35);
    let a = Ray::dot(r.d, &r.d) * q;
    let ea = s(2.2) * ed + s(16.0) * u;
    let (side, bb, ac) = (b.abs(), b * b, a * c.abs());
    let disc = bb - a * c;
    let edisc = s(2.0) * side * eb + eb * eb + a * (ec * s(1.2) + c.abs() * ea) + s(16.0) * u * (bb + ac) + s(1e-35);
    let root = disc.max(zero).sqrt();
    let eroot = (edisc * root.recip()).min(edisc.sqrt()) * s(1.01) + s(8.0) * u * root;
    let sum = root + side;
    let esum = eroot + eb + s(8.0) * u * sum;
    let rest = (sum - esum).recip();
    let (product, by_a) = (c.abs() * sum.recip(), a.recip());
    let eproduct = (ec + product * esum) * rest * s(1.1) + s(16.0) * u * product;
    let by_sum = sum * by_a;
    let eby_sum = s(1.3) * (esum * by_a + by_sum * ea) + s(16.0) * u * by_sum;
    let (outside, within) = (ec.lt(c), c.lt(-ec));
    let known = ed.lt(s(TURNED)) & esum.lt(sum);
    let ahead = outside & b.lt(-eb) & edisc.lt(disc) & known;
    let inside = within & known;
    // Of what leads away from outside, and of lines that pass by, nothing is met.
    let turned = ed.lt(s(TURNED));
    let passes = turned & (disc.lt(-edisc) | outside & eb.lt(b));
    let by_sums = inside & !zero.lt(b);
    let t = by_sum.select(by_sums, product);
    let et = eby_sum.select(by_sums, eproduct);
    let (lo, hi) = (t - et, t + et);
    let sure = (ahead | inside) & zero.lt(lo) & hi.lt(s(f32::INFINITY));
    Intersection { may: mask & !passes, sure, lo: lo.select(sure, zero), hi: hi.select(sure, s(f32::INFINITY)), inside }
}
