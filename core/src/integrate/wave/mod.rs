//! Many paths at once: packets find what rays meet, f64 lanes compute what is seen there.
//!
//! A wave holds the paths of a block of pixels and steps them from mirror to mirror. What a
//! packet cannot settle in f32 is settled among its few candidates in f64, and what f64 cannot
//! settle goes to exact arithmetic. `integrate::path` traces one path by the same operations and serves
//! scenes that f32 cannot hold, and the rare path that is longer than a wave keeps.

mod closest;
mod lanes;
mod light;
mod paths;
mod surfaces;
#[cfg(test)]
mod tests;

use std::cell::Cell;

use glam::DVec3;
use lanes::{Column, Rays, SurfaceInteractions, column};
use light::Shadows;
use paths::Paths;

use super::path::PathScratch;
use super::{RayCounts, Sample, Tracer};
use crate::bvh::{Boxes, Bvh};
use crate::film::PlanePoint;
use crate::simd::{Kernel, Simd};
use crate::traverse::filter::Filter;
use crate::traverse::packet::{Packet, Walk};

/// The most paths of a wave.
pub(crate) const PATHS: usize = 512;
/// Steps a wave keeps; longer paths are traced alone.
pub(crate) const STEPS: u32 = 64;
/// Starts farther out than this are left to f64.
const FAR: f64 = 1e4;

/// Indices of rays that met planes, spheres, triangles, nothing.
struct Kinds {
    counts: [usize; 4],
    lists: [Column<u32>; 4],
}

impl Default for Kinds {
    fn default() -> Self {
        Self { counts: [0; 4], lists: [column(0), column(0), column(0), column(0)] }
    }
}

/// Memory of a thread that traces waves.
pub(crate) struct WaveScratch {
    rays: Rays,
    next: Rays,
    interactions: SurfaceInteractions,
    shadows: Shadows,
    packet: Packet,
    walk: Walk,
    kinds: Kinds,
    /// Of each path, the light it has gathered.
    radiance: [Column<f64>; 3],
    /// Per path: rays so far; kept only where a path may outgrow a wave.
    mirrors: Vec<u32>,
    shadow_counts: Vec<u32>,
    trails: Vec<Column<u32>>,
    pub(crate) path: PathScratch,
}

impl Default for WaveScratch {
    fn default() -> Self {
        Self {
            rays: Rays::default(),
            next: Rays::default(),
            interactions: SurfaceInteractions::default(),
            shadows: Shadows::default(),
            packet: Packet::default(),
            walk: Walk::default(),
            kinds: Kinds::default(),
            radiance: [column(0.0), column(0.0), column(0.0)],
            mirrors: Vec::new(),
            shadow_counts: Vec::new(),
            trails: Vec::new(),
            path: PathScratch::default(),
        }
    }
}

thread_local! {
    static SCRATCH: Cell<Option<Box<WaveScratch>>> = const { Cell::new(None) };
}

/// Memory for more doubts than this is given back.
const DOUBTS: usize = 1 << 16;

impl WaveScratch {
    /// Does `work` with this thread's memory, which takes a while to be had and is the same for every scene. What
    /// does not end leaves none behind.
    pub(crate) fn with<T>(work: impl FnOnce(&mut Self) -> T) -> T {
        let mut scratch = SCRATCH.take().unwrap_or_default();
        let done = work(&mut scratch);
        if scratch.walk.doubts.capacity().max(scratch.path.query.capacity()) <= DOUBTS {
            SCRATCH.set(Some(scratch));
        }
        done
    }
}

/// One wave, to be run at some level.
pub(crate) struct Wave<'a> {
    pub(crate) tracer: &'a Tracer,
    /// At most [`PATHS`].
    pub(crate) points: &'a [PlanePoint],
    /// Mirrored rays of no more weight are not followed.
    pub(crate) least: f64,
    pub(crate) out: &'a mut [Sample],
    pub(crate) scratch: &'a mut WaveScratch,
    pub(crate) counts: &'a mut RayCounts,
}

impl Kernel for Wave<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self) {
        let prepared = &self.tracer.prepared;
        let (Some(filter), Boxes::F32(bvh)) = (&prepared.filter, &prepared.boxes) else {
            return self.run_scalar();
        };
        let WaveScratch {
            rays,
            next,
            interactions,
            shadows,
            packet,
            walk,
            kinds,
            radiance,
            mirrors,
            shadow_counts,
            trails,
            path,
        } = self.scratch;
        let n = self.points.len();
        let max_depth = self.tracer.settings.max_depth;
        for v in [&mut *mirrors, &mut *shadow_counts] {
            v.clear();
            v.resize(if max_depth > STEPS { n } else { 0 }, 0);
        }
        for sum in radiance.iter_mut() {
            sum[..n].fill(0.0);
        }
        let mut paths = Paths {
            tracer: self.tracer,
            points: self.points,
            radiance,
            mirrors,
            shadows: shadow_counts,
            counts: RayCounts { camera: n as u64, ..RayCounts::default() },
            trails,
            query: &mut path.query,
            refiners: Vec::new(),
            refined_interactions: Vec::new(),
            step: 0,
            least: self.least,
        };
        shadows.forget(prepared.local.lights.len());
        let stage = Stage { tracer: self.tracer, filter, bvh };
        stage.camera::<S>(self.points, rays);
        for depth in 1..=max_depth.min(STEPS) {
            if rays.count == 0 || self.tracer.is_unwanted() {
                break;
            }
            paths.step = depth as usize - 1;
            paths.refined_interactions.clear();
            stage.closest::<S>(rays, interactions, packet, walk, &mut paths);
            stage.interactions::<S>(rays, interactions, kinds, &mut paths);
            stage.light::<S>(rays, interactions, shadows, packet, walk, &mut paths);
            stage.gather::<S>(rays, interactions, &mut paths);
            next.count = 0;
            if self.tracer.mirrors && depth < max_depth {
                stage.reflect::<S>(rays, interactions, next, &mut paths);
            }
            std::mem::swap(rays, next);
        }
        let unresolved = paths.unresolved();
        paths.counts.unresolved = unresolved.iter().filter(|u| **u).count() as u64;
        *self.counts += paths.counts;
        for (k, out) in self.out.iter_mut().enumerate() {
            out.radiance = DVec3::new(paths.radiance[0][k], paths.radiance[1][k], paths.radiance[2][k]);
        }
        if self.tracer.is_unwanted() {
            return;
        }
        // Rays are left only where a wave keeps fewer steps than the paths may have.
        for &k in &rays.path[..rays.count] {
            let k = k as usize;
            self.counts.camera -= 1;
            self.counts.unresolved -= u64::from(unresolved.get(k).is_some_and(|u| *u));
            self.counts.mirror -= u64::from(mirrors[k]);
            self.counts.shadow -= u64::from(shadow_counts[k]);
            self.out[k] = self.tracer.sample(self.points[k], self.least, path, self.counts);
        }
    }

    fn run_scalar(self) {
        for (p, out) in self.points.iter().zip(self.out) {
            *out = self.tracer.sample(*p, self.least, &mut self.scratch.path, self.counts);
        }
    }
}

struct Stage<'a> {
    tracer: &'a Tracer,
    filter: &'a Filter,
    bvh: &'a Bvh<f32>,
}
