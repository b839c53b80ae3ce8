//! A sphere before rays in f32.
//!
//! **Bound.** Of spheres around the eye as in [`super::giant`], with u = 2⁻²⁴ and one rounding more of every number;
//! `near` is at least eo + 12u·|o|.

use super::LocalSphere;
use crate::scene::Sphere;
use crate::shapes::Local;
use crate::shapes::filter::{InLeaves, Intersection, Numbers, Ray, U32, each, is_normal, norm1, single};
use crate::simd::Floats;

/// Numbers of a sphere: centre, radius, a bound on the distance of its points from the origin, the
/// id's bits.
pub(crate) const NUMBERS: usize = 6;

/// Squares of lesser radii, and what they are rounded by, are not for f32.
const LEAST_RADIUS: f64 = 1e-15;

/// One sphere in all lanes, or one in each.
pub(crate) struct Lanes<F> {
    c: [F; 3],
    r: F,
    reach: F,
}

/// A sphere around the eye, see [`super::giant`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Giant {
    pub(crate) m: [f32; 3],
    pub(crate) q: f32,
    pub(crate) k: f32,
}

/// The greatest error of a direction that bounds here allow for.
const TURNED: f32 = 0.05;

/// The numbers of a sphere whose id is `id` as a number.
pub(crate) fn row(s: &LocalSphere, id: f32) -> [f32; NUMBERS] {
    let sound = s.r > LEAST_RADIUS;
    // Of a sphere that is met within any distance, nothing is sure in f32.
    let reach = if sound { ((s.c.dot(s.c).sqrt() + s.r) * (1.0 + 1e-6)) as f32 } else { f32::INFINITY };
    let [x, y, z] = single(s.c);
    [x, y, z, s.r as f32, reach, id]
}

impl InLeaves<NUMBERS> for Sphere {
    type Lanes<F: Floats> = Lanes<F>;
    type Giant32 = Giant;

    /// A point that no ray of a scene comes near; nothing else reaches no farther than the origin.
    const NEVER: [f32; NUMBERS] = [1e15, -0.7e15, 0.3e15, 0.0, 0.0, f32::NAN];

    fn row(&self, i: usize, local: &Local, id: f32) -> [f32; NUMBERS] {
        row(&local.spheres[i], id)
    }

    #[inline(always)]
    fn load<F: Floats>(numbers: &impl Numbers<F>) -> Lanes<F> {
        Lanes { c: each!(k => numbers.number(k)), r: numbers.number(3), reach: numbers.number(4) }
    }

    #[inline(always)]
    fn intersect<F: Floats>(r: &Ray<F>, sphere: &Lanes<F>, mask: F::Mask) -> Intersection<F> {
        let s = F::splat;
        let oc = each!(k => r.o[k] - sphere.c[k]);
        let b = oc[0].fma(r.d[0], oc[1].fma(r.d[1], oc[2] * r.d[2]));
        let mid = -(b * r.dd_inv);
        let q = each!(k => r.d[k].fma(mid, oc[k]));
        let qq = q[0].fma(q[0], q[1].fma(q[1], q[2] * q[2]));
        let radius = sphere.r;
        let pos = r.pos(sphere.reach);
        let outer = radius + pos;
        let (zero, none) = (s(0.0), F::Mask::from(0));
        let may = mask & !(outer * outer * s(1.0 + 16.0 * U32)).lt(qq);
        if may == none {
            return Intersection { may, sure: none, lo: zero, hi: zero, inside: none };
        }
        let rr = radius * radius;
        let hh = rr - qq;
        let dhh = pos * (s(2.0) * radius + s(3.0) * pos) + s(16.0 * U32) * rr;
        let h = hh.max(zero).sqrt();
        let half = h * r.inv_len;
        let dh = (dhh * h.recip()).min(dhh.sqrt());
        let e = (pos + dh) * r.inv_len + s(32.0 * U32) * (mid.abs() + half);
        let inner = radius - pos;
        let cut = zero.lt(inner) & qq.lt(inner * inner * s(1.0 - 16.0 * U32));
        let (near, far) = (mid - half, mid + half);
        let ahead = zero.lt(near - e);
        let within = (near + e).lt(zero) & zero.lt(far - e);
        let sure = cut & (ahead | within);
        let inside = within & !ahead;
        // Where neither root is sure, anything from the near one on.
        let lo = (far - e).select(cut & inside, near - e);
        let hi = (near + e).select(cut & ahead, far + e);
        Intersection { may: may & !hi.lt(zero), sure, lo, hi, inside }
    }

    /// They surely meet it again, at the root of −2(oc·d)/d², which is off by no more than in f64 with its bounds. What
    /// stands for a giant here is not met: giants are asked for apart.
    #[inline(always)]
    fn from_inside<F: Floats>(r: &Ray<F>, sphere: &Lanes<F>, within: F::Mask, m: Intersection<F>) -> Intersection<F> {
        let s = F::splat;
        let within = within & s(0.0).lt(sphere.reach);
        let oc = each!(k => r.o[k] - sphere.c[k]);
        let t = Ray::dot(oc, &r.d) * r.dd_inv * s(-2.0);
        let e = s(4.0) * r.pos(sphere.reach) * r.inv_len + s(32.0 * U32) * t.abs();
        let (lo, hi) = ((t - e).max(s(0.0)), t + e);
        // Written so that what is not a number is not sure.
        let sure = within & hi.lt(s(f32::INFINITY));
        Intersection {
            may: m.may | within,
            sure: (m.sure & !within) | sure,
            lo: lo.select(sure, s(0.0)).select(within, m.lo),
            hi: hi.select(sure, s(f32::INFINITY)).select(within, m.hi),
            inside: m.inside | within,
        }
    }

    fn single((s, _): &Self::Giant) -> Option<Giant> {
        let giant = Giant { m: single(s.m), q: s.q as f32, k: s.k as f32 };
        (is_normal(giant.q) && is_normal(giant.k)).then_some(giant)
    }

    #[inline(always)]
    fn intersect_giant<F: Floats>(r: &Ray<F>, g: &Giant, ed: F, mask: F::Mask) -> Intersection<F> {
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
        let edisc =
            s(2.0) * side * eb + eb * eb + a * (ec * s(1.2) + c.abs() * ea) + s(16.0) * u * (bb + ac) + s(1e-35);
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
        Intersection {
            may: mask & !passes,
            sure,
            lo: lo.select(sure, zero),
            hi: hi.select(sure, s(f32::INFINITY)),
            inside,
        }
    }
}
