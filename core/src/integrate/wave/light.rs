//! The light that reaches places, and what of it goes along the paths.

use glam::DVec3;

use super::lanes::{Column, Eight, Rays, SurfaceInteractions, column, eight_at, eight_at_mut, load, load3};
use super::paths::Paths;
use super::{PATHS, Stage};
use crate::integrate::shade;
use crate::numeric::{Real, V3};
use crate::shapes::Decision;
use crate::simd::{F64x8, LANES, Simd};
use crate::traverse::packet::{self, Packet, Spot, Ties, Walk};

/// Shadow segments towards one light.
pub(super) struct Shadows {
    count: usize,
    /// Indices of the places they start from; ascending.
    at: Column<u32>,
    cosine: Column<f64>,
    /// What blocked each light last.
    last: Vec<Option<Spot>>,
}

impl Default for Shadows {
    fn default() -> Self {
        Self { count: 0, at: column(0), cosine: column(0.0), last: Vec::new() }
    }
}

impl Shadows {
    /// Forgets what blocked `lights` lights.
    pub(super) fn forget(&mut self, lights: usize) {
        self.last.clear();
        self.last.resize(lights, None);
    }
}

const FIRST_EIGHT: [u32; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

impl Stage<'_> {
    /// Adds up the light that reaches each place.
    #[inline(always)]
    pub(super) fn light<S: Simd>(
        &self,
        rays: &Rays,
        interactions: &mut SurfaceInteractions,
        shadows: &mut Shadows,
        packet: &mut Packet,
        walk: &mut Walk,
        paths: &mut Paths,
    ) {
        for (k, &light) in self.tracer.prepared.local.lights.iter().enumerate() {
            let light = V3::<S::F64x8>::splat(light);
            self.facing::<S>(rays, interactions, k, light, shadows, paths);
            let mut last = shadows.last[k];
            let exempt = self.tracer.prepared.planes_with_light(k);
            for first in (0..shadows.count).step_by(LANES) {
                let low = Eight::of(&shadows.at, first, shadows.count);
                let high = Eight::of(&shadows.at, first + 8, shadows.count);
                let near = self.fill::<S>(
                    packet,
                    &interactions.towards::<S>(&low, light),
                    &interactions.towards::<S>(&high, light),
                );
                packet.own[..8].copy_from_slice(&low.take(&interactions.met));
                packet.own[8..].copy_from_slice(&high.take(&interactions.met));
                let all = ((1u32 << LANES.min(shadows.count - first)) - 1) as u16;
                packet.active = all & near;
                let ties = Ties::new(&self.tracer.prepared, packet, Some(k));
                let mut blocked = match self.packets {
                    Some((filter, bvh)) => packet::blocked::<S>(filter, bvh, packet, &mut last, exempt, ties, walk),
                    None => 0,
                };
                for lane in packet::lanes(walk.open(all, near)) {
                    let i = shadows.at[first + lane] as usize;
                    let candidates = walk.doubts_of(lane);
                    let candidates = (near >> lane & 1 == 1).then_some(candidates);
                    if paths.settle_shadow(rays, interactions, i, k, candidates) {
                        blocked |= 1 << lane;
                    }
                }
                let lit = all & !blocked;
                for (at, eight, lit) in [(first, low, lit as u8), (first + 8, high, (lit >> 8) as u8)] {
                    if lit != 0 {
                        let mut cosines = [0.0; 8];
                        for (lane, (to, x)) in cosines.iter_mut().zip(eight_at(&shadows.cosine, at)).enumerate() {
                            *to = if lit >> lane & 1 == 1 { *x } else { 0.0 };
                        }
                        let sum = eight.load::<S>(&interactions.lit) + S::F64x8::load(&cosines);
                        eight.store(sum, &mut interactions.lit);
                    }
                }
            }
            shadows.last[k] = last;
        }
    }

    /// Lists the places that face `light`, the `k`-th, and would show it.
    #[inline(always)]
    fn facing<S: Simd>(
        &self,
        rays: &Rays,
        interactions: &SurfaceInteractions,
        k: usize,
        light: V3<S::F64x8>,
        shadows: &mut Shadows,
        paths: &mut Paths,
    ) {
        shadows.count = 0;
        let has_triangles = !self.tracer.prepared.scene.triangles().is_empty();
        for at in (0..rays.count).step_by(8) {
            let mut cosine = shade::cosine(&interactions.eight::<S>(at), light);
            let mut faces = cosine.positive();
            if interactions.any_refined(at) {
                let mut cosines = [0.0; 8];
                cosine.store(&mut cosines);
                paths.wide_cosines(interactions, at, k, &mut cosines);
                cosine = S::F64x8::load(&cosines);
                faces = cosine.positive();
            }
            // What met nothing has no albedo.
            let albedo = load3::<S>(&interactions.albedo, at);
            faces &= (albedo.x + albedo.y + albedo.z).positive() & (0xff >> (8 - 8.min(rays.count - at)));
            // A light in the plane of a surface does not light it.
            let in_plane = self.tracer.prepared.planes_with_light(k);
            if !in_plane.is_empty() {
                for lane in packet::lanes(u16::from(faces)) {
                    if in_plane.contains(&interactions.met[at + lane]) {
                        faces &= !(1 << lane);
                    }
                }
            }
            if has_triangles {
                let grazing = faces & (S::F64x8::splat(shade::GRAZING) - cosine).positive();
                for lane in packet::lanes(u16::from(grazing)) {
                    let met = Decision::of(interactions.met[at + lane]);
                    if met.is_some_and(|met| self.tracer.prepared.has_light_in_plane(met.id, k)) {
                        faces &= !(1 << lane);
                    }
                }
            }
            let indices = FIRST_EIGHT.map(|lane| at as u32 + lane);
            *eight_at_mut(&mut shadows.at, shadows.count) = S::compress(&indices, faces);
            cosine.compress(faces).store(eight_at_mut(&mut shadows.cosine, shadows.count));
            shadows.count += faces.count_ones() as usize;
        }
        paths.counts.shadow += shadows.count as u64;
    }

    /// Adds what each place sends along its path.
    #[inline(always)]
    pub(super) fn gather<S: Simd>(&self, rays: &Rays, interactions: &SurfaceInteractions, paths: &mut Paths) {
        for at in (0..rays.count).step_by(8) {
            let albedo = load3::<S>(&interactions.albedo, at);
            // What met nothing has no albedo, and sends nothing.
            let share = load::<S>(&rays.throughput, at) * load::<S>(&interactions.lit, at);
            let direct = albedo * share;
            let (count, path) = (8.min(rays.count - at), eight_at(&rays.path, at));
            if count == 8 && path[7] - path[0] == 7 {
                let to = path[0] as usize;
                for (sum, x) in paths.radiance.iter_mut().zip([direct.x, direct.y, direct.z]) {
                    (load::<S>(sum, to) + x).store(eight_at_mut(sum, to));
                }
            } else {
                let mut lanes = [[0.0; 8]; 3];
                direct.x.store(&mut lanes[0]);
                direct.y.store(&mut lanes[1]);
                direct.z.store(&mut lanes[2]);
                for lane in 0..count {
                    let light = DVec3::new(lanes[0][lane], lanes[1][lane], lanes[2][lane]);
                    paths.shine(path[lane] as usize, light);
                }
            }
        }
    }
}

const _: () = assert!(PATHS.is_multiple_of(LANES));
