//! One object before sixteen rays, or up to eight before one: the same arithmetic.

use super::{Packet, U32};
use crate::simd::{F32x8, F32x16, Floats, LANES, MOST, Rows, Simd};
use crate::traverse::filter::{FlatPlane, SPHERE, TRIANGLE};

/// [e(0), e(1), e(2)] without a closure, which would not be compiled for the level's instructions.
macro_rules! each {
    ($k:ident => $e:expr) => {
        [
            {
                let $k = 0;
                $e
            },
            {
                let $k = 1;
                $e
            },
            {
                let $k = 2;
                $e
            },
        ]
    };
}
/// Rays as objects meet them: a lane each, or one in all lanes.
#[derive(Clone, Copy)]
pub(super) struct Ray<F> {
    pub(super) o: [F; 3],
    pub(super) d: [F; 3],
    pub(super) near: F,
    per: F,
    dd_inv: F,
    pub(super) len: F,
    inv_len: F,
}

impl<F: Floats> Ray<F> {
    /// How far an object within `reach` of the origin may be misplaced.
    #[inline(always)]
    fn pos(&self, reach: F) -> F {
        self.per.fma(reach, self.near)
    }

    #[inline(always)]
    pub(super) fn dot(a: [F; 3], b: &[F; 3]) -> F {
        a[0].fma(b[0], a[1].fma(b[1], a[2] * b[2]))
    }
}

/// The packet in registers.
#[derive(Clone, Copy)]
pub(super) struct Rays<S: Simd> {
    pub(super) ray: Ray<S::F32x16>,
    pub(super) inv: [S::F32x16; 3],
    /// −(o ± pad)/d: for lower and for upper ends of boxes.
    pub(super) low: [S::F32x16; 3],
    pub(super) high: [S::F32x16; 3],
    pub(super) pad: S::F32x16,
}

impl<S: Simd> Rays<S> {
    #[inline(always)]
    pub(super) fn new(p: &Packet) -> Self {
        let s = S::F32x16::splat;
        let o = each!(k => S::F32x16::load(&p.o[k]));
        let d = each!(k => S::F32x16::load(&p.d[k]));
        let near = S::F32x16::load(&p.near);
        let per = S::F32x16::load(&p.per);
        let pad = S::F32x16::load(&p.pad);
        // A component of 0 becomes tiny: a turn far below `ed`, and no 0 · ∞.
        let tiny = s(1e-30);
        let inv = each!(k => tiny.select(d[k].abs().lt(tiny), d[k]).recip());
        let low = each!(k => -((o[k] + pad) * inv[k]));
        let high = each!(k => -((o[k] - pad) * inv[k]));
        let dd = d[0].fma(d[0], d[1].fma(d[1], d[2] * d[2]));
        let dd_inv = dd.recip();
        let len = dd.sqrt() * s(1.0 + 16.0 * U32);
        let inv_len = len.recip() * s(1.0 + 32.0 * U32);
        Self { ray: Ray { o, d, near, per, dd_inv, len, inv_len }, inv, low, high, pad }
    }

    /// Where the box is entered and left, `from` 0 `to` the bound.
    #[inline(always)]
    pub(super) fn slabs(&self, lo: [f32; 3], hi: [f32; 3], bound: S::F32x16) -> (S::F32x16, S::F32x16) {
        let (mut near, mut far) = (S::F32x16::splat(0.0), bound);
        for k in 0..3 {
            let a = S::F32x16::splat(lo[k]).fma(self.inv[k], self.low[k]);
            let b = S::F32x16::splat(hi[k]).fma(self.inv[k], self.high[k]);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        (near, far)
    }

    /// The same for rays whose directions have one sign on each axis: boxes are entered at `enter`
    /// and left at `leave`, where `ends` holds −(o ± pad)/d.
    #[inline(always)]
    pub(super) fn one_sign(
        &self,
        enter: [f32; 3],
        leave: [f32; 3],
        ends: &[[S::F32x16; 3]; 2],
        bound: S::F32x16,
    ) -> (S::F32x16, S::F32x16) {
        let (mut near, mut far) = (S::F32x16::splat(0.0), bound);
        for k in 0..3 {
            near = near.max(S::F32x16::splat(enter[k]).fma(self.inv[k], ends[0][k]));
            far = far.min(S::F32x16::splat(leave[k]).fma(self.inv[k], ends[1][k]));
        }
        (near, far)
    }
}

/// A packet's rays in memory, from where single ones are taken.
#[derive(Default)]
pub(super) struct Apart {
    rays: [[f32; LANES]; 12],
    /// Whether these are the packet's.
    filled: bool,
}

impl Apart {
    pub(super) fn forget(&mut self) {
        self.filled = false;
    }

    #[inline(always)]
    pub(super) fn fill<S: Simd>(&mut self, rays: &Rays<S>) {
        if self.filled {
            return;
        }
        self.filled = true;
        for k in 0..3 {
            rays.inv[k].store(&mut self.rays[k]);
            rays.low[k].store(&mut self.rays[3 + k]);
            rays.high[k].store(&mut self.rays[6 + k]);
        }
        rays.ray.dd_inv.store(&mut self.rays[9]);
        rays.ray.len.store(&mut self.rays[10]);
        rays.ray.inv_len.store(&mut self.rays[11]);
    }

    /// 1/d, and −(o ± pad)/d for lower and for upper ends of boxes.
    #[inline(always)]
    pub(super) fn slabs(&self, lane: usize) -> [[f32; 3]; 3] {
        each!(i => each!(k => self.rays[3 * i + k][lane]))
    }

    #[inline(always)]
    pub(super) fn ray<S: Simd>(&self, p: &Packet, lane: usize) -> Ray<S::F32x8> {
        let s = S::F32x8::splat;
        Ray {
            o: each!(k => s(p.o[k][lane])),
            d: each!(k => s(p.d[k][lane])),
            near: s(p.near[lane]),
            per: s(p.per[lane]),
            dd_inv: s(self.rays[9][lane]),
            len: s(self.rays[10][lane]),
            inv_len: s(self.rays[11][lane]),
        }
    }
}

/// Lanes that may meet an object, those that surely do, and where.
pub(super) struct Intersection<F: Floats> {
    pub(super) may: F::Mask,
    pub(super) sure: F::Mask,
    pub(super) lo: F,
    pub(super) hi: F,
    pub(super) inside: F::Mask,
}

/// One object in all lanes, or one in each; see `traverse::filter`.
pub(super) struct Triangle<F> {
    n: [F; 3],
    h: F,
    u: [F; 3],
    u0: F,
    v: [F; 3],
    v0: F,
    slope: F,
    reach: F,
}

pub(super) struct Sphere<F> {
    c: [F; 3],
    r: F,
    reach: F,
}

macro_rules! triangle {
    ($k:ident => $row:expr) => {{
        let [n, u, v] = [each!($k => $row), each!(i => { let $k = 4 + i; $row }), each!(i => { let $k = 8 + i; $row })];
        let [h, u0, v0] = each!(i => { let $k = 3 + 4 * i; $row });
        let [slope, reach] = [{ let $k = 12; $row }, { let $k = 13; $row }];
        Triangle { n, h, u, u0, v, v0, slope, reach }
    }};
}

macro_rules! sphere {
    ($k:ident => $row:expr) => {
        Sphere { c: each!($k => $row), r: { let $k = 3; $row }, reach: { let $k = 4; $row } }
    };
}

impl<F: Floats> Triangle<F> {
    #[inline(always)]
    pub(super) fn one(rows: &[[f32; MOST]; TRIANGLE], i: usize) -> Self {
        triangle!(k => F::splat(rows[k][i % MOST]))
    }

    #[inline(always)]
    pub(super) fn lone(leaf: &Rows<'_, TRIANGLE>, i: usize) -> Self {
        triangle!(k => F::splat(leaf.at(k, i)))
    }
}

impl<F: F32x8> Triangle<F> {
    #[inline(always)]
    pub(super) fn all(leaf: &Rows<'_, TRIANGLE>) -> Self {
        triangle!(k => F::load(leaf.row(k)))
    }
}

impl<F: Floats> Sphere<F> {
    #[inline(always)]
    pub(super) fn one(rows: &[[f32; MOST]; SPHERE], i: usize) -> Self {
        sphere!(k => F::splat(rows[k][i % MOST]))
    }

    #[inline(always)]
    pub(super) fn lone(leaf: &Rows<'_, SPHERE>, i: usize) -> Self {
        sphere!(k => F::splat(leaf.at(k, i)))
    }
}

impl<F: F32x8> Sphere<F> {
    #[inline(always)]
    pub(super) fn all(leaf: &Rows<'_, SPHERE>) -> Self {
        sphere!(k => F::load(leaf.row(k)))
    }
}

#[inline(always)]
pub(super) fn intersect_triangle<F: Floats>(r: &Ray<F>, t: &Triangle<F>, mask: F::Mask) -> Intersection<F> {
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

#[inline(always)]
pub(super) fn intersect_sphere<F: Floats>(r: &Ray<F>, sphere: &Sphere<F>, mask: F::Mask) -> Intersection<F> {
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

#[inline(always)]
pub(super) fn intersect_plane<F: Floats>(r: &Ray<F>, p: &FlatPlane, ed: F, mask: F::Mask) -> Intersection<F> {
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
