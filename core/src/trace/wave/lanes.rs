//! Rays and places side by side, and their way into vectors and back.

use glam::DVec3;

use crate::geometry::{Ray, Real, V3};
use crate::simd::{Double, Simd};
use crate::trace::packet::NONE;
use crate::trace::shade::{self, Place};

/// Rays side by side, padded to whole packets.
#[derive(Default)]
pub(super) struct Rays {
    pub(super) o: [Vec<f64>; 3],
    pub(super) d: [Vec<f64>; 3],
    pub(super) eo: Vec<f64>,
    pub(super) ed: Vec<f64>,
    /// The object a ray starts on, with `packet::INSIDE`, or [`NONE`].
    pub(super) own: Vec<u32>,
    /// Which path it belongs to.
    pub(super) path: Vec<u32>,
    pub(super) throughput: Vec<f64>,
}

impl Rays {
    pub(super) fn len(&self) -> usize {
        self.path.len()
    }

    pub(super) fn clear(&mut self) {
        for v in self.o.iter_mut().chain(&mut self.d) {
            v.clear();
        }
        self.eo.clear();
        self.ed.clear();
        self.own.clear();
        self.path.clear();
        self.throughput.clear();
    }

    /// Rays `at` to `at` + 8; lanes beyond the last are zero.
    #[inline(always)]
    pub(super) fn eight<S: Simd>(&self, at: usize) -> Ray<S::Double> {
        let at = at.min(self.len());
        Ray::new(load3::<S>(&self.o, at), load3::<S>(&self.d, at), load::<S>(&self.eo, at), load::<S>(&self.ed, at))
    }

    /// The rays at eight indices.
    #[inline(always)]
    pub(super) fn pick<S: Simd>(&self, at: &[u32; 8]) -> Ray<S::Double> {
        Ray::new(
            collect3::<S>(&self.o, at),
            collect3::<S>(&self.d, at),
            collect::<S>(&self.eo, at),
            collect::<S>(&self.ed, at),
        )
    }

    pub(super) fn one(&self, i: usize) -> Ray {
        let v = |a: &[Vec<f64>; 3]| V3 { x: a[0][i], y: a[1][i], z: a[2][i] };
        Ray::new(v(&self.o), v(&self.d), self.eo[i], self.ed[i])
    }
}

/// What rays met, as shading needs it; one entry a ray.
#[derive(Default)]
pub(super) struct Places {
    pub(super) p: [Vec<f64>; 3],
    pub(super) ep: Vec<f64>,
    pub(super) n: [Vec<f64>; 3],
    pub(super) en: Vec<f64>,
    pub(super) albedo: [Vec<f64>; 3],
    pub(super) reflect: Vec<f64>,
    pub(super) lit: Vec<f64>,
    /// What was met, with `packet::INSIDE`; [`NONE`] for nothing.
    pub(super) met: Vec<u32>,
    /// One more than the index into the paths' refined places, 0 where f64 serves.
    pub(super) refined: Vec<u32>,
}

impl Places {
    pub(super) fn reset(&mut self, n: usize) {
        for v in self.p.iter_mut().chain(&mut self.n).chain(&mut self.albedo) {
            v.clear();
            v.resize(n, 0.0);
        }
        for v in [&mut self.ep, &mut self.en, &mut self.reflect, &mut self.lit] {
            v.clear();
            v.resize(n, 0.0);
        }
        self.met.clear();
        self.met.resize(n, NONE);
        self.refined.clear();
        self.refined.resize(n, 0);
    }

    /// Segments to `light` from the places at eight indices.
    #[inline(always)]
    pub(super) fn towards<S: Simd>(&self, at: &[u32], light: V3<S::Double>) -> Ray<S::Double> {
        let mut eight = [0; 8];
        eight.copy_from_slice(at);
        let place = Place {
            p: collect3::<S>(&self.p, &eight),
            ep: collect::<S>(&self.ep, &eight),
            n: V3::splat(DVec3::ZERO),
            en: S::Double::splat(0.0),
        };
        shade::towards(&place, light, light - place.p)
    }

    pub(super) fn set(&mut self, i: usize, place: &Place) {
        (self.p[0][i], self.p[1][i], self.p[2][i]) = (place.p.x, place.p.y, place.p.z);
        (self.n[0][i], self.n[1][i], self.n[2][i]) = (place.n.x, place.n.y, place.n.z);
        (self.ep[i], self.en[i]) = (place.ep, place.en);
    }

    /// Places `at` to `at` + 8.
    #[inline(always)]
    pub(super) fn eight<S: Simd>(&self, at: usize) -> Place<S::Double> {
        Place {
            p: load3::<S>(&self.p, at),
            ep: load::<S>(&self.ep, at),
            n: load3::<S>(&self.n, at),
            en: load::<S>(&self.en, at),
        }
    }

    pub(super) fn one(&self, i: usize) -> Place {
        let v = |a: &[Vec<f64>; 3]| V3 { x: a[0][i], y: a[1][i], z: a[2][i] };
        Place { p: v(&self.p), ep: self.ep[i], n: v(&self.n), en: self.en[i] }
    }
}

#[inline(always)]
pub(super) fn load<S: Simd>(v: &[f64], at: usize) -> S::Double {
    let mut lanes = [0.0; 8];
    let part = &v[at..v.len().min(at + 8)];
    if let Ok(whole) = part.try_into() {
        return S::Double::load(whole);
    }
    lanes[..part.len()].copy_from_slice(part);
    S::Double::load(&lanes)
}

#[inline(always)]
pub(super) fn load3<S: Simd>(v: &[Vec<f64>; 3], at: usize) -> V3<S::Double> {
    V3 { x: load::<S>(&v[0], at), y: load::<S>(&v[1], at), z: load::<S>(&v[2], at) }
}

#[inline(always)]
pub(super) fn three<S: Simd>(lanes: &[[f64; 8]], at: usize) -> V3<S::Double> {
    V3 { x: S::Double::load(&lanes[at]), y: S::Double::load(&lanes[at + 1]), z: S::Double::load(&lanes[at + 2]) }
}

#[inline(always)]
pub(super) fn collect<S: Simd>(v: &[f64], at: &[u32; 8]) -> S::Double {
    let mut lanes = [0.0; 8];
    for k in 0..8 {
        lanes[k] = v[at[k] as usize];
    }
    S::Double::load(&lanes)
}

#[inline(always)]
pub(super) fn collect3<S: Simd>(v: &[Vec<f64>; 3], at: &[u32; 8]) -> V3<S::Double> {
    V3 { x: collect::<S>(&v[0], at), y: collect::<S>(&v[1], at), z: collect::<S>(&v[2], at) }
}

#[inline(always)]
pub(super) fn scatter<D: Double>(x: D, to: &mut [f64], at: &[u32]) {
    let mut lanes = [0.0; 8];
    x.store(&mut lanes);
    for (&i, x) in at.iter().zip(lanes) {
        to[i as usize] = x;
    }
}
