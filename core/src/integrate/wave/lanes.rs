//! Rays and places side by side, and their way into vectors and back.

use glam::DVec3;

use super::PATHS;
use crate::integrate::Tracer;
use crate::integrate::shade;
use crate::numeric::{Real, V3};
use crate::shapes::{NONE, Ray, SurfaceInteraction};
use crate::simd::{F64x8, LANES, Simd};

/// One number of each ray of a wave. There is room behind the last for a vector to be read or
/// written whole; what stands there means nothing.
pub(super) type Column<T> = Box<[T; PATHS + LANES]>;

pub(super) fn column<T: Copy>(x: T) -> Column<T> {
    Box::new([x; PATHS + LANES])
}

fn columns() -> [Column<f64>; 3] {
    [column(0.0), column(0.0), column(0.0)]
}

/// Rays side by side.
pub(super) struct Rays {
    pub(super) count: usize,
    pub(super) o: [Column<f64>; 3],
    pub(super) d: [Column<f64>; 3],
    pub(super) eo: Column<f64>,
    pub(super) ed: Column<f64>,
    /// The object a ray starts on, with `packet::INSIDE`, or [`NONE`].
    pub(super) own: Column<u32>,
    /// Which path it belongs to; ascending.
    pub(super) path: Column<u32>,
    pub(super) throughput: Column<f64>,
}

impl Default for Rays {
    fn default() -> Self {
        Self {
            count: 0,
            o: columns(),
            d: columns(),
            eo: column(0.0),
            ed: column(0.0),
            own: column(NONE),
            path: column(0),
            throughput: column(0.0),
        }
    }
}

impl Rays {
    /// Rays `at` to `at` + 8.
    #[inline(always)]
    pub(super) fn eight<S: Simd>(&self, at: usize) -> Ray<S::F64x8> {
        Ray::new(load3::<S>(&self.o, at), load3::<S>(&self.d, at), load::<S>(&self.eo, at), load::<S>(&self.ed, at))
    }

    /// The rays at eight indices.
    #[inline(always)]
    pub(super) fn pick<S: Simd>(&self, at: &Eight) -> Ray<S::F64x8> {
        Ray::new(at.load3::<S>(&self.o), at.load3::<S>(&self.d), at.load::<S>(&self.eo), at.load::<S>(&self.ed))
    }

    /// Copies some of the rays `to` where others were.
    pub(super) fn take(&self, some: std::ops::Range<usize>, to: &mut Self) {
        to.count = some.len();
        let n = ..some.len();
        for (from, to) in self.o.iter().chain(&self.d).zip(to.o.iter_mut().chain(&mut to.d)) {
            to[n].copy_from_slice(&from[some.clone()]);
        }
        for (from, to) in [(&self.eo, &mut to.eo), (&self.ed, &mut to.ed), (&self.throughput, &mut to.throughput)] {
            to[n].copy_from_slice(&from[some.clone()]);
        }
        to.own[n].copy_from_slice(&self.own[some.clone()]);
        to.path[n].copy_from_slice(&self.path[some]);
    }

    pub(super) fn one(&self, i: usize) -> Ray {
        let v = |a: &[Column<f64>; 3]| V3 { x: a[0][i], y: a[1][i], z: a[2][i] };
        Ray::new(v(&self.o), v(&self.d), self.eo[i], self.ed[i])
    }
}

/// What rays met, as shading needs it; one entry a ray.
pub(super) struct SurfaceInteractions {
    pub(super) p: [Column<f64>; 3],
    pub(super) ep: Column<f64>,
    pub(super) n: [Column<f64>; 3],
    pub(super) en: Column<f64>,
    pub(super) albedo: [Column<f64>; 3],
    pub(super) reflect: Column<f64>,
    pub(super) lit: Column<f64>,
    /// What was met, with `packet::INSIDE`; [`NONE`] for nothing.
    pub(super) met: Column<u32>,
    /// One more than the index into the paths' refined places, 0 where f64 serves.
    pub(super) refined: Column<u32>,
}

impl Default for SurfaceInteractions {
    fn default() -> Self {
        Self {
            p: columns(),
            ep: column(0.0),
            n: columns(),
            en: column(0.0),
            albedo: columns(),
            reflect: column(0.0),
            lit: column(0.0),
            met: column(NONE),
            refined: column(0),
        }
    }
}

impl SurfaceInteractions {
    /// Forgets what the first `n` were, as far as rays that meet nothing would not overwrite it.
    pub(super) fn reset(&mut self, n: usize) {
        let n = n.next_multiple_of(8);
        for v in self.albedo.iter_mut().chain([&mut self.ep, &mut self.en, &mut self.reflect, &mut self.lit]) {
            v[..n].fill(0.0);
        }
        self.refined[..n].fill(0);
    }

    /// Segments to `light` from the places at eight indices.
    #[inline(always)]
    pub(super) fn towards<S: Simd>(&self, at: &Eight, light: V3<S::F64x8>) -> Ray<S::F64x8> {
        let interaction = SurfaceInteraction {
            p: at.load3::<S>(&self.p),
            ep: at.load::<S>(&self.ep),
            n: V3::splat(DVec3::ZERO),
            en: S::F64x8::splat(0.0),
        };
        shade::towards(&interaction, light, light - interaction.p)
    }

    pub(super) fn set(&mut self, i: usize, interaction: &SurfaceInteraction) {
        (self.p[0][i], self.p[1][i], self.p[2][i]) = (interaction.p.x, interaction.p.y, interaction.p.z);
        (self.n[0][i], self.n[1][i], self.n[2][i]) = (interaction.n.x, interaction.n.y, interaction.n.z);
        (self.ep[i], self.en[i]) = (interaction.ep, interaction.en);
    }

    /// Surface interactions `at` to `at` + 8.
    #[inline(always)]
    pub(super) fn eight<S: Simd>(&self, at: usize) -> SurfaceInteraction<S::F64x8> {
        SurfaceInteraction {
            p: load3::<S>(&self.p, at),
            ep: load::<S>(&self.ep, at),
            n: load3::<S>(&self.n, at),
            en: load::<S>(&self.en, at),
        }
    }

    /// The segment from the i-th place to a light.
    pub(super) fn segment(&self, i: usize, tracer: &Tracer, light: usize) -> Ray {
        let (interaction, to) = (self.one(i), V3::splat(tracer.prepared.local.lights[light]));
        shade::towards(&interaction, to, to - interaction.p)
    }

    pub(super) fn one(&self, i: usize) -> SurfaceInteraction {
        let v = |a: &[Column<f64>; 3]| V3 { x: a[0][i], y: a[1][i], z: a[2][i] };
        SurfaceInteraction { p: v(&self.p), ep: self.ep[i], n: v(&self.n), en: self.en[i] }
    }

    /// Whether one of places `at` to `at` + 8 is refined.
    #[inline(always)]
    pub(super) fn any_refined(&self, at: usize) -> bool {
        eight_at(&self.refined, at).iter().any(|&r| r != 0)
    }
}

/// Eight indices of rays, ascending; the first stands in for what is missing.
#[derive(Clone, Copy)]
pub(super) struct Eight {
    at: [u32; 8],
    count: usize,
    /// Whether they follow one another without a gap.
    run: bool,
}

impl Eight {
    /// Up to eight of `list[from..n]`.
    #[inline(always)]
    pub(super) fn of(list: &Column<u32>, from: usize, n: usize) -> Self {
        let mut at = *eight_at(list, from);
        let count = n.saturating_sub(from).min(8);
        if count < 8 {
            for k in count..8 {
                at[k] = if count == 0 { 0 } else { at[0] };
            }
        }
        Self { at, count, run: count == 8 && at[7] - at[0] == 7 }
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// The index in lane `k`.
    #[inline(always)]
    pub(super) fn lane(&self, k: usize) -> usize {
        self.at[k] as usize
    }

    #[inline(always)]
    pub(super) fn load<S: Simd>(&self, v: &Column<f64>) -> S::F64x8 {
        if self.run {
            return load::<S>(v, self.at[0] as usize);
        }
        let mut lanes = [0.0; 8];
        for k in 0..8 {
            lanes[k] = v[self.at[k] as usize];
        }
        S::F64x8::load(&lanes)
    }

    #[inline(always)]
    pub(super) fn load3<S: Simd>(&self, v: &[Column<f64>; 3]) -> V3<S::F64x8> {
        V3 { x: self.load::<S>(&v[0]), y: self.load::<S>(&v[1]), z: self.load::<S>(&v[2]) }
    }

    /// Of u32.
    #[inline(always)]
    pub(super) fn take(&self, v: &Column<u32>) -> [u32; 8] {
        if self.run {
            return *eight_at(v, self.at[0] as usize);
        }
        let mut lanes = [0; 8];
        for k in 0..8 {
            lanes[k] = v[self.at[k] as usize];
        }
        lanes
    }

    #[inline(always)]
    pub(super) fn store<D: F64x8>(&self, x: D, to: &mut Column<f64>) {
        if self.run {
            return store(x, to, self.at[0] as usize);
        }
        let mut lanes = [0.0; 8];
        x.store(&mut lanes);
        for k in 0..self.count {
            to[self.at[k] as usize] = lanes[k];
        }
    }

    #[inline(always)]
    pub(super) fn store3<D: F64x8>(&self, x: V3<D>, to: &mut [Column<f64>; 3]) {
        self.store(x.x, &mut to[0]);
        self.store(x.y, &mut to[1]);
        self.store(x.z, &mut to[2]);
    }
}

/// Elements `at` to `at` + 8.
#[inline(always)]
pub(super) fn eight_at<T>(v: &Column<T>, at: usize) -> &[T; 8] {
    match v[at..at + 8].first_chunk() {
        Some(eight) => eight,
        None => unreachable!("eight are eight"),
    }
}

#[inline(always)]
pub(super) fn eight_at_mut<T>(v: &mut Column<T>, at: usize) -> &mut [T; 8] {
    match v[at..at + 8].first_chunk_mut() {
        Some(eight) => eight,
        None => unreachable!("eight are eight"),
    }
}

#[inline(always)]
pub(super) fn load<S: Simd>(v: &Column<f64>, at: usize) -> S::F64x8 {
    S::F64x8::load(eight_at(v, at))
}

#[inline(always)]
pub(super) fn load3<S: Simd>(v: &[Column<f64>; 3], at: usize) -> V3<S::F64x8> {
    V3 { x: load::<S>(&v[0], at), y: load::<S>(&v[1], at), z: load::<S>(&v[2], at) }
}

#[inline(always)]
pub(super) fn store<D: F64x8>(x: D, to: &mut Column<f64>, at: usize) {
    x.store(eight_at_mut(to, at));
}
