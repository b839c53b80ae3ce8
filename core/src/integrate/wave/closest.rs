//! The rays of a wave, and what they meet.

use super::Stage;
use super::lanes::{Rays, SurfaceInteractions, eight_at, store};
use super::paths::Paths;
use crate::film::PlanePoint;
use crate::integrate::camera;
use crate::numeric::V3;
use crate::scene::Triangle;
use crate::shapes::filter::U32;
use crate::shapes::{INSIDE, Listed, NONE, Ray};
use crate::simd::{F32x16, F64x8, Floats, LANES, Mask, Simd, prefetch};
use crate::traverse::packet::{self, Packet, Ties, Walk};

impl Stage<'_> {
    #[inline(always)]
    pub(super) fn camera<S: Simd>(&self, points: &[PlanePoint], rays: &mut Rays) {
        let n = points.len();
        let frame = &self.tracer.frame;
        let (forward, right, up) = (V3::splat(frame.forward), V3::splat(frame.right), V3::splat(frame.up));
        for (k, points) in points.chunks(8).enumerate() {
            let (mut x, mut y) = ([0.0; 8], [0.0; 8]);
            for (lane, p) in points.iter().enumerate() {
                (x[lane], y[lane]) = (f64::from(p.x), f64::from(p.y));
            }
            // Off by no more than `camera::TURN`, which counts these operations.
            let d: V3<S::F64x8> = forward + right * S::F64x8::load(&x) + up * S::F64x8::load(&y);
            store(d.x, &mut rays.d[0], 8 * k);
            store(d.y, &mut rays.d[1], 8 * k);
            store(d.z, &mut rays.d[2], 8 * k);
        }
        for o in &mut rays.o {
            o[..n].fill(0.0);
        }
        rays.eo[..n].fill(0.0);
        rays.ed[..n].fill(camera::TURN);
        rays.own[..n].fill(NONE);
        rays.throughput[..n].fill(1.0);
        for (k, path) in rays.path[..n].iter_mut().enumerate() {
            *path = k as u32;
        }
        rays.count = n;
    }

    /// Fills lanes 0..8 and 8..16 of `packet` from f64 rays; gives those that f32 can follow.
    #[inline(always)]
    pub(super) fn fill<S: Simd>(&self, packet: &mut Packet, low: &Ray<S::F64x8>, high: &Ray<S::F64x8>) -> u16 {
        let s = S::F32x16::splat;
        let o =
            V3 { x: S::narrow(low.o.x, high.o.x), y: S::narrow(low.o.y, high.o.y), z: S::narrow(low.o.z, high.o.z) };
        let d =
            V3 { x: S::narrow(low.d.x, high.d.x), y: S::narrow(low.d.y, high.d.y), z: S::narrow(low.d.z, high.d.z) };
        o.x.store(&mut packet.o[0]);
        o.y.store(&mut packet.o[1]);
        o.z.store(&mut packet.o[2]);
        d.x.store(&mut packet.d[0]);
        d.y.store(&mut packet.d[1]);
        d.z.store(&mut packet.d[2]);
        let up = s(1.0 + 8.0 * U32);
        let eo = S::narrow(low.eo, high.eo) * up;
        let ed = S::narrow(low.ed, high.ed) * up;
        let far = (o.x * o.x + o.y * o.y + o.z * o.z).sqrt() * up;
        ed.store(&mut packet.ed);
        let turn = ed * s(1.1) + s(10.0 * U32);
        ((eo + far * (turn + s(2.0 * U32))) * up).store(&mut packet.near);
        (turn * up).store(&mut packet.per);
        ((eo + turn * far + ed * s(1.1 * self.reach)) * s(1.1)).store(&mut packet.pad);
        // Squares of lengths that f32 holds to its full precision.
        let dd = d.x * d.x + d.y * d.y + d.z * d.z;
        far.lt(s(self.far)) & s(1e-36).lt(dd) & dd.lt(s(1e30))
    }

    /// Walks with the packet of the rays from `at` on, of `n`; gives its lanes, and those that f32 can
    /// follow.
    #[inline(always)]
    pub(super) fn nearest<S: Simd>(
        &self,
        rays: &Rays,
        at: usize,
        n: usize,
        packet: &mut Packet,
        walk: &mut Walk,
    ) -> [Mask; 2] {
        let near = self.fill::<S>(packet, &rays.eight::<S>(at), &rays.eight::<S>(at + 8));
        let all = ((1u32 << LANES.min(n - at)) - 1) as u16;
        packet.own[..8].copy_from_slice(eight_at(&rays.own, at));
        packet.own[8..].copy_from_slice(eight_at(&rays.own, at + 8));
        packet.active = all & near;
        let ties = Ties::new(&self.tracer.prepared, packet, None);
        match self.packets {
            Some((filter, bvh)) => packet::closest::<S>(filter, bvh, packet, ties, walk),
            None => walk.forget(),
        }
        [all, near]
    }

    #[inline(always)]
    pub(super) fn closest<S: Simd>(
        &self,
        rays: &Rays,
        interactions: &mut SurfaceInteractions,
        packet: &mut Packet,
        walk: &mut Walk,
        paths: &mut Paths,
    ) {
        let n = rays.count;
        for at in (0..n).step_by(LANES) {
            let [all, near] = self.nearest::<S>(rays, at, n, packet, walk);
            interactions.met[at..at + LANES].copy_from_slice(&walk.best);
            self.expect(&walk.best);
            for lane in packet::lanes(walk.open(all, near)) {
                let sure = (walk.best[lane] != NONE).then_some(walk.best[lane]);
                let candidates = walk.doubts_of(lane).chain(sure);
                let candidates = (near >> lane & 1 == 1).then_some(candidates);
                paths.settle(rays, at + lane, candidates, interactions);
            }
        }
    }

    /// Asks memory for the triangles that will be shaded.
    #[inline(always)]
    fn expect(&self, met: &[u32; LANES]) {
        let scene = &self.tracer.prepared.scene;
        if scene.triangles().is_empty() {
            return;
        }
        let first = Triangle::first(scene);
        for id in met {
            prefetch(scene.triangles(), (id & !INSIDE).wrapping_sub(first) as usize, 1);
        }
    }
}
