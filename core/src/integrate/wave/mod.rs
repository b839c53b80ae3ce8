//! Many paths at once: packets find what rays meet, f64 lanes compute what is seen there.
//!
//! A wave holds the paths of a block of pixels and steps them from mirror to mirror. What a
//! packet cannot settle in f32 is settled among its few candidates in f64, and what f64 cannot
//! settle goes to exact arithmetic. In scenes that f32 cannot hold, f64 is asked at once.

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

use super::{RayCounts, Sample, Tracer};
use crate::bvh::Bvh;
use crate::film::PlanePoint;
use crate::shapes::SHAPES;
use crate::simd::{Kernel, LANES, Simd};
use crate::traverse::Scratch;
use crate::traverse::filter::Filter;
use crate::traverse::packet::{Packet, Walk};

/// The most paths of a wave.
pub(crate) const PATHS: usize = 512;
/// Rays of a path after which a wave goes on with a few paths at a time: what each has met so far takes memory.
const STEPS: u32 = 64;
/// Starts farther out than this are left to f64.
const FAR: f32 = 1e4;

/// Indices of rays that met each shape, and nothing.
struct Kinds {
    counts: [usize; SHAPES + 1],
    lists: [Column<u32>; SHAPES + 1],
}

impl Default for Kinds {
    fn default() -> Self {
        Self { counts: [0; SHAPES + 1], lists: std::array::from_fn(|_| column(0)) }
    }
}

/// Memory of a thread that traces waves.
pub(crate) struct WaveScratch {
    rays: Rays,
    next: Rays,
    /// Rays that wait while a few paths go on.
    left: Rays,
    interactions: SurfaceInteractions,
    shadows: Shadows,
    packet: Packet,
    walk: Walk,
    kinds: Kinds,
    /// Of each path, the light it has gathered.
    radiance: [Column<f64>; 3],
    /// What each path met, per step.
    trails: Vec<Column<u32>>,
    pub(crate) query: Scratch,
}

impl Default for WaveScratch {
    fn default() -> Self {
        Self {
            rays: Rays::default(),
            next: Rays::default(),
            left: Rays::default(),
            interactions: SurfaceInteractions::default(),
            shadows: Shadows::default(),
            packet: Packet::default(),
            walk: Walk::default(),
            kinds: Kinds::default(),
            radiance: [column(0.0), column(0.0), column(0.0)],
            trails: Vec::new(),
            query: Scratch::default(),
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
        if scratch.walk.doubts.capacity().max(scratch.query.capacity()) <= DOUBTS {
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
        let Wave { tracer, points, least, out, scratch, counts } = self;
        let prepared = &tracer.prepared;
        let WaveScratch { rays, next, left, interactions, shadows, packet, walk, kinds, radiance, trails, query } =
            scratch;
        let n = points.len();
        for sum in radiance.iter_mut() {
            sum[..n].fill(0.0);
        }
        let mut paths = Paths {
            tracer,
            points,
            radiance,
            counts: RayCounts { camera: n as u64, ..RayCounts::default() },
            trails,
            far: Vec::new(),
            query,
            refiners: Vec::new(),
            refined_interactions: Vec::new(),
            step: 0,
            least,
        };
        shadows.forget(prepared.local.lights.len());
        let stage = Stage::new(tracer);
        let max_depth = tracer.settings.max_depth;
        stage.camera::<S>(points, rays);
        let (mut steps, mut waiting) = (0..max_depth.min(STEPS), 0..0);
        // One place that steps paths, whether all of them or a few: compiled once.
        loop {
            for step in steps {
                if rays.count == 0 || tracer.is_unwanted() {
                    break;
                }
                paths.step = step as usize;
                paths.refined_interactions.clear();
                stage.closest::<S>(rays, interactions, packet, walk, &mut paths);
                stage.interactions::<S>(rays, interactions, kinds, &mut paths);
                stage.light::<S>(rays, interactions, shadows, packet, walk, &mut paths);
                stage.gather::<S>(rays, interactions, &mut paths);
                next.count = 0;
                if tracer.mirrors && step + 1 < max_depth {
                    stage.reflect::<S>(rays, interactions, next, &mut paths);
                }
                std::mem::swap(rays, next);
            }
            if waiting.end == 0 && max_depth > STEPS {
                std::mem::swap(rays, left);
                waiting = 0..left.count;
            }
            if waiting.is_empty() {
                break;
            }
            let few = waiting.start..waiting.end.min(waiting.start + LANES);
            paths.go_far(&left.path[few.clone()]);
            left.take(few.clone(), rays);
            waiting.start = few.end;
            steps = STEPS..max_depth;
        }
        paths.counts.unresolved = paths.unresolved();
        *counts += paths.counts;
        for (k, out) in out.iter_mut().enumerate() {
            out.radiance = DVec3::new(paths.radiance[0][k], paths.radiance[1][k], paths.radiance[2][k]);
        }
    }
}

struct Stage<'a> {
    tracer: &'a Tracer,
    /// What packets walk through, where f32 holds the scene.
    packets: Option<(&'a Filter, &'a Bvh<f32>)>,
    /// How far its objects reach.
    reach: f32,
    /// Rays that start farther out are left to f64: without packets, all.
    far: f32,
}

impl<'a> Stage<'a> {
    fn new(tracer: &'a Tracer) -> Self {
        let packets = tracer.packets();
        let [reach, far] = packets.map_or([0.0; 2], |(filter, _)| [filter.reach, FAR]);
        Self { tracer, packets, reach, far }
    }
}
