//! One object before sixteen rays.

use crate::simd::{Mask, Simd, Single};
use crate::trace::filter::{FlatPlane, FlatSphere, FlatTriangle};

use super::{Packet, U32};

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
/// The packet in registers.
#[derive(Clone, Copy)]
pub(super) struct Rays<S: Simd> {
    pub(super) o: [S::Single; 3],
    pub(super) d: [S::Single; 3],
    pub(super) inv: [S::Single; 3],
    /// −(o ± pad)/d: for lower and for upper ends of boxes.
    pub(super) low: [S::Single; 3],
    pub(super) high: [S::Single; 3],
    pub(super) pad: S::Single,
    near: S::Single,
    per: S::Single,
    dd_inv: S::Single,
    len: S::Single,
    inv_len: S::Single,
}

impl<S: Simd> Rays<S> {
    #[inline(always)]
    pub(super) fn new(p: &Packet) -> Self {
        let o = each!(k => S::Single::load(&p.o[k]));
        let d = each!(k => S::Single::load(&p.d[k]));
        let near = S::Single::load(&p.near);
        let per = S::Single::load(&p.per);
        let pad = S::Single::load(&p.pad);
        // A component of 0 becomes tiny: a turn far below `ed`, and no 0 · ∞.
        let tiny = S::Single::splat(1e-30);
        let inv = each!(k => tiny.select(d[k].abs().lt(tiny), d[k]).recip());
        let low = each!(k => -((o[k] + pad) * inv[k]));
        let high = each!(k => -((o[k] - pad) * inv[k]));
        let dd = d[0].fma(d[0], d[1].fma(d[1], d[2] * d[2]));
        let dd_inv = dd.recip();
        let len = dd.sqrt() * S::Single::splat(1.0 + 16.0 * U32);
        let inv_len = len.recip() * S::Single::splat(1.0 + 32.0 * U32);
        Self { o, d, inv, low, high, pad, near, per, dd_inv, len, inv_len }
    }

    /// Where the box is entered and left, `from` 0 `to` the bound.
    #[inline(always)]
    pub(super) fn slabs(&self, lo: [f32; 3], hi: [f32; 3], bound: S::Single) -> (S::Single, S::Single) {
        let (mut near, mut far) = (S::Single::splat(0.0), bound);
        for k in 0..3 {
            let a = S::Single::splat(lo[k]).fma(self.inv[k], self.low[k]);
            let b = S::Single::splat(hi[k]).fma(self.inv[k], self.high[k]);
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
        ends: &[[S::Single; 3]; 2],
        bound: S::Single,
    ) -> (S::Single, S::Single) {
        let (mut near, mut far) = (S::Single::splat(0.0), bound);
        for k in 0..3 {
            near = near.max(S::Single::splat(enter[k]).fma(self.inv[k], ends[0][k]));
            far = far.min(S::Single::splat(leave[k]).fma(self.inv[k], ends[1][k]));
        }
        (near, far)
    }

    /// How far an object within `reach` of the origin may be misplaced.
    #[inline(always)]
    fn pos(&self, reach: f32) -> S::Single {
        self.per.fma(S::Single::splat(reach), self.near)
    }

    #[inline(always)]
    fn dot(a: [f32; 3], b: &[S::Single; 3]) -> S::Single {
        let s = S::Single::splat;
        s(a[0]).fma(b[0], s(a[1]).fma(b[1], s(a[2]) * b[2]))
    }
}

/// Lanes that may meet an object, those that surely do, and where.
pub(super) struct Meeting<S: Simd> {
    pub(super) may: Mask,
    pub(super) sure: Mask,
    pub(super) lo: S::Single,
    pub(super) hi: S::Single,
    pub(super) inside: Mask,
}

#[inline(always)]
pub(super) fn meet_triangle<S: Simd>(r: &Rays<S>, t: &FlatTriangle, mask: Mask) -> Meeting<S> {
    let s = S::Single::splat;
    let den = Rays::<S>::dot(t.n, &r.d);
    let num = s(t.h) - Rays::<S>::dot(t.n, &r.o);
    let inv = den.recip();
    let at = num * inv;
    let p = each!(k => r.d[k].fma(at, r.o[k]));
    let u = Rays::<S>::dot(t.u, &p) + s(t.u0);
    let v = Rays::<S>::dot(t.v, &p) + s(t.v0);
    let steep = inv.abs();
    let pos = r.pos(t.reach);
    let e = s(t.slope) * pos * r.len.fma(steep, s(1.2));
    let w = s(1.0) - u - v;
    let least = u.min(v).min(w);
    let et = s(1.2) * pos * steep;
    let (lo, hi) = (at - et, at + et);
    let zero = s(0.0);
    // Written so that NaN may be met and is never sure.
    let may = mask & !least.lt(-e) & !hi.lt(zero);
    let sure = e.lt(least) & zero.lt(lo);
    Meeting { may, sure, lo, hi, inside: 0 }
}

#[inline(always)]
pub(super) fn meet_sphere<S: Simd>(r: &Rays<S>, sphere: &FlatSphere, mask: Mask) -> Meeting<S> {
    let s = S::Single::splat;
    let oc = each!(k => r.o[k] - s(sphere.c[k]));
    let b = oc[0].fma(r.d[0], oc[1].fma(r.d[1], oc[2] * r.d[2]));
    let mid = -(b * r.dd_inv);
    let q = each!(k => r.d[k].fma(mid, oc[k]));
    let qq = q[0].fma(q[0], q[1].fma(q[1], q[2] * q[2]));
    let radius = s(sphere.r);
    let pos = r.pos(sphere.reach);
    let outer = radius + pos;
    let zero = s(0.0);
    let may = mask & !(outer * outer * s(1.0 + 16.0 * U32)).lt(qq);
    if may == 0 {
        return Meeting { may, sure: 0, lo: zero, hi: zero, inside: 0 };
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
    Meeting { may: may & !hi.lt(zero), sure, lo, hi, inside }
}

#[inline(always)]
pub(super) fn meet_plane<S: Simd>(r: &Rays<S>, p: &FlatPlane, ed: S::Single, mask: Mask) -> Meeting<S> {
    let s = S::Single::splat;
    let den = Rays::<S>::dot(p.n, &r.d);
    let num = s(p.h) - Rays::<S>::dot(p.n, &r.o);
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
    Meeting { may, sure, lo: lo.select(leans, s(0.0)), hi: hi.select(leans, s(f32::INFINITY)), inside: 0 }
}
