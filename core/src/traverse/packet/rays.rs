//! A packet's rays in registers, and single ones out of them.

use super::Packet;
use crate::shapes::filter::{Ray, U32, each};
use crate::simd::{F32x16, Floats, LANES, Simd};

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
