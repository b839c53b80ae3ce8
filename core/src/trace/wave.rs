//! Many paths at once: packets find what rays meet, f64 lanes compute what is seen there.
//!
//! A wave holds the paths of a block of pixels and steps them from mirror to mirror. What a
//! packet cannot settle in f32 is settled among its few candidates in f64. A path that needs
//! more than that (wide arithmetic, or more steps than a wave keeps) leaves the wave and is
//! traced again from the camera by `trace::path`, which gives every path the same value by the
//! same operations: leaving early or late changes nothing but time.

use glam::DVec3;

use super::arbiter::Decision;
use super::camera::PlanePoint;
use super::filter::Filter;
use super::packet::{self, INSIDE, NONE, Packet, U32, Walk};
use super::path::{PathScratch, mix};
use super::query::{Closest, Occluded};
use super::shade::{self, Place};
use super::texture;
use super::{RayCounts, Sample, Tracer};
use crate::bvh::{Boxes, Wide};
use crate::geometry::local::kind;
use crate::geometry::plane::LocalPlane;
use crate::geometry::sphere::LocalSphere;
use crate::geometry::triangle::LocalTriangle;
use crate::geometry::{ObjectId, Ray, Real, V3};
use crate::scene::Pigment;
use crate::simd::{Double, Kernel, LANES, Simd, Single};

/// The most paths of a wave.
pub(crate) const PATHS: usize = 512;
/// Steps a wave keeps; longer paths are traced alone.
const STEPS: u32 = 64;
/// Starts farther out than this are left to f64.
const FAR: f64 = 1e4;

/// Rays side by side, padded to whole packets.
#[derive(Default)]
struct Rays {
    o: [Vec<f64>; 3],
    d: [Vec<f64>; 3],
    eo: Vec<f64>,
    ed: Vec<f64>,
    /// The object a ray starts on, with [`INSIDE`], or [`NONE`].
    own: Vec<u32>,
    /// Which path it belongs to.
    path: Vec<u32>,
    throughput: Vec<f64>,
}

impl Rays {
    fn len(&self) -> usize {
        self.path.len()
    }

    fn clear(&mut self) {
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
    fn eight<S: Simd>(&self, at: usize) -> Ray<S::Double> {
        let at = at.min(self.len());
        Ray::new(load3::<S>(&self.o, at), load3::<S>(&self.d, at), load::<S>(&self.eo, at), load::<S>(&self.ed, at))
    }

    /// The rays at eight indices.
    #[inline(always)]
    fn pick<S: Simd>(&self, at: &[u32; 8]) -> Ray<S::Double> {
        Ray::new(
            collect3::<S>(&self.o, at),
            collect3::<S>(&self.d, at),
            collect::<S>(&self.eo, at),
            collect::<S>(&self.ed, at),
        )
    }

    fn one(&self, i: usize) -> Ray {
        let v = |a: &[Vec<f64>; 3]| V3 { x: a[0][i], y: a[1][i], z: a[2][i] };
        Ray::new(v(&self.o), v(&self.d), self.eo[i], self.ed[i])
    }
}

/// What rays met, as shading needs it; one entry a ray.
#[derive(Default)]
struct Places {
    p: [Vec<f64>; 3],
    ep: Vec<f64>,
    n: [Vec<f64>; 3],
    en: Vec<f64>,
    albedo: [Vec<f64>; 3],
    reflect: Vec<f64>,
    lit: Vec<f64>,
    /// What was met, with [`INSIDE`]; [`NONE`] for nothing, or where the path has left.
    met: Vec<u32>,
}

impl Places {
    fn reset(&mut self, n: usize) {
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
    }

    /// Segments to `light` from the places at eight indices.
    #[inline(always)]
    fn towards<S: Simd>(&self, at: &[u32], light: V3<S::Double>) -> Ray<S::Double> {
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

    fn one(&self, i: usize) -> Place {
        let v = |a: &[Vec<f64>; 3]| V3 { x: a[0][i], y: a[1][i], z: a[2][i] };
        Place { p: v(&self.p), ep: self.ep[i], n: v(&self.n), en: self.en[i] }
    }
}

/// Shadow segments towards one light.
#[derive(Default)]
struct Shadows {
    /// Indices of the places they start from.
    at: Vec<u32>,
    cosine: Vec<f64>,
}

/// Memory of a thread that traces waves.
#[derive(Default)]
pub(crate) struct WaveScratch {
    rays: Rays,
    next: Rays,
    places: Places,
    shadows: Shadows,
    packet: Packet,
    walk: Walk,
    /// Indices of rays that met planes, spheres, triangles.
    kinds: [Vec<u32>; 3],
    /// Per path: counts, and whether it left.
    mirrors: Vec<u32>,
    shadow_counts: Vec<u32>,
    left: Vec<bool>,
    pub(crate) path: PathScratch,
}

/// One wave, to be run at some level.
pub(crate) struct Wave<'a> {
    pub(crate) tracer: &'a Tracer,
    /// At most [`PATHS`].
    pub(crate) points: &'a [PlanePoint],
    pub(crate) out: &'a mut [Sample],
    pub(crate) scratch: &'a mut WaveScratch,
    pub(crate) counts: &'a mut RayCounts,
}

impl Kernel for Wave<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self) {
        let prepared = &self.tracer.prepared;
        let (Some(filter), Boxes::Single(wide)) = (&prepared.filter, &prepared.boxes) else {
            for (p, out) in self.points.iter().zip(self.out) {
                *out = self.tracer.sample(*p, &mut self.scratch.path, self.counts);
            }
            return;
        };
        let WaveScratch { rays, next, places, shadows, packet, walk, kinds, mirrors, shadow_counts, left, path } =
            self.scratch;
        let n = self.points.len();
        let stage = Stage { tracer: self.tracer, filter, wide };
        for v in [&mut *mirrors, &mut *shadow_counts] {
            v.clear();
            v.resize(n, 0);
        }
        left.clear();
        left.resize(n, false);
        self.out.fill(Sample { radiance: DVec3::ZERO, signature: 0 });
        stage.camera::<S>(self.points, rays);
        for depth in 1..=self.tracer.settings.max_depth {
            if rays.len() == 0 {
                break;
            }
            if depth > STEPS {
                for &p in &rays.path {
                    left[p as usize] = true;
                }
                break;
            }
            places.reset(rays.len().next_multiple_of(LANES));
            stage.closest::<S>(rays, places, packet, walk, path, left);
            stage.places::<S>(rays, places, kinds, left, self.out);
            stage.light::<S>(rays, places, shadows, packet, walk, path, left, shadow_counts, depth, self.out);
            stage.gather(rays, places, left, self.out);
            next.clear();
            if depth < self.tracer.settings.max_depth && self.tracer.mirrors {
                stage.reflect::<S>(rays, places, next, left, mirrors);
            }
            std::mem::swap(rays, next);
        }
        for (k, point) in self.points.iter().enumerate() {
            if left[k] {
                self.out[k] = self.tracer.sample(*point, path, self.counts);
            } else {
                self.counts.camera += 1;
                self.counts.mirror += u64::from(mirrors[k]);
                self.counts.shadow += u64::from(shadow_counts[k]);
            }
        }
    }
}

struct Stage<'a> {
    tracer: &'a Tracer,
    filter: &'a Filter,
    wide: &'a Wide<f32>,
}

#[inline(always)]
fn load<S: Simd>(v: &[f64], at: usize) -> S::Double {
    let mut lanes = [0.0; 8];
    let part = &v[at..v.len().min(at + 8)];
    if let Ok(whole) = part.try_into() {
        return S::Double::load(whole);
    }
    lanes[..part.len()].copy_from_slice(part);
    S::Double::load(&lanes)
}

#[inline(always)]
fn load3<S: Simd>(v: &[Vec<f64>; 3], at: usize) -> V3<S::Double> {
    V3 { x: load::<S>(&v[0], at), y: load::<S>(&v[1], at), z: load::<S>(&v[2], at) }
}

#[inline(always)]
fn three<S: Simd>(lanes: &[[f64; 8]], at: usize) -> V3<S::Double> {
    V3 { x: S::Double::load(&lanes[at]), y: S::Double::load(&lanes[at + 1]), z: S::Double::load(&lanes[at + 2]) }
}

#[inline(always)]
fn collect<S: Simd>(v: &[f64], at: &[u32; 8]) -> S::Double {
    let mut lanes = [0.0; 8];
    for k in 0..8 {
        lanes[k] = v[at[k] as usize];
    }
    S::Double::load(&lanes)
}

#[inline(always)]
fn collect3<S: Simd>(v: &[Vec<f64>; 3], at: &[u32; 8]) -> V3<S::Double> {
    V3 { x: collect::<S>(&v[0], at), y: collect::<S>(&v[1], at), z: collect::<S>(&v[2], at) }
}

#[inline(always)]
fn scatter<D: Double>(x: D, to: &mut [f64], at: &[u32]) {
    let mut lanes = [0.0; 8];
    x.store(&mut lanes);
    for (&i, x) in at.iter().zip(lanes) {
        to[i as usize] = x;
    }
}

impl Stage<'_> {
    #[inline(always)]
    fn camera<S: Simd>(&self, points: &[PlanePoint], rays: &mut Rays) {
        rays.clear();
        let frame = &self.tracer.frame;
        for p in points {
            let d = frame.direction(*p);
            rays.d[0].push(d.x);
            rays.d[1].push(d.y);
            rays.d[2].push(d.z);
        }
        let n = points.len();
        for o in &mut rays.o {
            o.resize(n, 0.0);
        }
        rays.eo.resize(n, 0.0);
        rays.ed.resize(n, super::camera::TURN);
        rays.own.resize(n, NONE);
        rays.path.extend(0..n as u32);
        rays.throughput.resize(n, 1.0);
    }

    /// Fills lanes 0..8 or 8..16 of `packet` from f64 rays.
    #[inline(always)]
    fn fill<S: Simd>(&self, packet: &mut Packet, low: &Ray<S::Double>, high: &Ray<S::Double>) -> u16 {
        let s = S::Single::splat;
        S::narrow(low.o.x, high.o.x).store(&mut packet.o[0]);
        S::narrow(low.o.y, high.o.y).store(&mut packet.o[1]);
        S::narrow(low.o.z, high.o.z).store(&mut packet.o[2]);
        S::narrow(low.d.x, high.d.x).store(&mut packet.d[0]);
        S::narrow(low.d.y, high.d.y).store(&mut packet.d[1]);
        S::narrow(low.d.z, high.d.z).store(&mut packet.d[2]);
        let up = s(1.0 + 4.0 * U32);
        let eo = S::narrow(low.eo, high.eo) * up;
        let ed = S::narrow(low.ed, high.ed) * up;
        let far = S::narrow(low.o.norm1(), high.o.norm1()) * up;
        ed.store(&mut packet.ed);
        let pos = ed.fma(s(1.1), s(24.0 * U32)).fma(far + s(self.filter.reach), eo);
        (pos * up).store(&mut packet.pos);
        far.lt(s(FAR as f32))
    }

    #[inline(always)]
    fn closest<S: Simd>(
        &self,
        rays: &Rays,
        places: &mut Places,
        packet: &mut Packet,
        walk: &mut Walk,
        path: &mut PathScratch,
        left: &mut [bool],
    ) {
        let n = rays.len();
        for at in (0..n).step_by(LANES) {
            let near = self.fill::<S>(packet, &rays.eight::<S>(at), &rays.eight::<S>(at + 8));
            let count = LANES.min(n - at);
            packet.own = [NONE; LANES];
            packet.own[..count].copy_from_slice(&rays.own[at..at + count]);
            let all = (((1u32 << count) - 1) & 0xffff) as u16;
            packet.active = all & near;
            packet::closest::<S>(self.filter, self.wide, packet, walk);
            places.met[at..at + count].copy_from_slice(&walk.best[..count]);
            let mut open = all & !near;
            for d in &walk.doubts {
                open |= 1 << d.lane;
            }
            while open != 0 {
                let lane = open.trailing_zeros() as usize;
                open &= open - 1;
                let candidates = walk
                    .doubts
                    .iter()
                    .filter(|d| usize::from(d.lane) == lane)
                    .map(|d| d.id)
                    .chain((walk.best[lane] != NONE).then_some(walk.best[lane]));
                let candidates = (near >> lane & 1 == 1).then_some(candidates);
                self.settle(rays, at + lane, candidates, places, path, left);
            }
        }
    }

    /// Decides in f64 what ray `i` meets: among `candidates`, or in the whole scene.
    #[inline(never)]
    fn settle(
        &self,
        rays: &Rays,
        i: usize,
        candidates: Option<impl Iterator<Item = u32>>,
        places: &mut Places,
        path: &mut PathScratch,
        left: &mut [bool],
    ) {
        let prepared = &self.tracer.prepared;
        let (ray, from) = (rays.one(i), decision(rays.own[i]));
        let found = match candidates {
            Some(ids) => prepared.closest_among(&ray, from, ids.map(|id| ObjectId(id & !INSIDE)), &mut path.query),
            None => prepared.closest(&ray, from, &mut path.query),
        };
        places.met[i] = match found {
            Closest::Nothing => NONE,
            Closest::Sure(d) => code(d),
            Closest::Doubt => {
                left[rays.path[i] as usize] = true;
                NONE
            }
        };
    }

    /// Computes where rays meet what they are known to meet; what met nothing sees the background.
    #[inline(always)]
    fn places<S: Simd>(
        &self,
        rays: &Rays,
        places: &mut Places,
        kinds: &mut [Vec<u32>; 3],
        left: &mut [bool],
        out: &mut [Sample],
    ) {
        let tracer = self.tracer;
        let local = &tracer.prepared.local;
        for k in kinds.iter_mut() {
            k.clear();
        }
        let planes = local.planes.len() as u32;
        let spheres = planes + local.spheres.len() as u32;
        for i in 0..rays.len() {
            let id = places.met[i];
            let path = rays.path[i] as usize;
            if left[path] {
                continue;
            }
            if id == NONE {
                out[path].radiance += tracer.background * rays.throughput[i];
                out[path].signature = mix(out[path].signature, u64::MAX);
                continue;
            }
            let bare = id & !INSIDE;
            kinds[usize::from(bare >= planes) + usize::from(bare >= spheres)].push(i as u32);
            out[path].signature = mix(out[path].signature, u64::from(bare) << 1 | u64::from(id & INSIDE != 0));
        }
        for (which, list) in kinds.iter().enumerate() {
            for at in list.chunks(8) {
                // Missing lanes repeat the first.
                let mut eight = [at[0]; 8];
                eight[..at.len()].copy_from_slice(at);
                let ray = rays.pick::<S>(&eight);
                let mut ids = [0; 8];
                for k in 0..8 {
                    ids[k] = (places.met[eight[k] as usize] & !INSIDE) as usize;
                }
                let place = match which {
                    0 => self.planes::<S>(&ray, &ids),
                    1 => {
                        let (mut inner, mut own) = ([0.0; 8], [0.0; 8]);
                        for k in 0..8 {
                            let (met, from) = (places.met[eight[k] as usize], rays.own[eight[k] as usize]);
                            inner[k] = if met & INSIDE != 0 { 1.0 } else { 0.0 };
                            own[k] = if from != NONE && (met ^ from) & !INSIDE == 0 { 1.0 } else { 0.0 };
                        }
                        self.spheres::<S>(&ray, &ids, &inner, &own)
                    }
                    _ => self.triangles::<S>(&ray, &ids),
                };
                scatter(place.p.x, &mut places.p[0], at);
                scatter(place.p.y, &mut places.p[1], at);
                scatter(place.p.z, &mut places.p[2], at);
                scatter(place.n.x, &mut places.n[0], at);
                scatter(place.n.y, &mut places.n[1], at);
                scatter(place.n.z, &mut places.n[2], at);
                scatter(place.ep, &mut places.ep, at);
                scatter(place.en, &mut places.en, at);
                let fine = place.en.le(S::Double::splat(shade::NORMAL));
                for (lane, (&i, id)) in at.iter().zip(ids).enumerate() {
                    let i = i as usize;
                    if fine >> lane & 1 == 0 {
                        left[rays.path[i] as usize] = true;
                        continue;
                    }
                    let material = &tracer.materials[tracer.prepared.surface_of(ObjectId(id as u32)).0 as usize];
                    let mut albedo = material.albedo;
                    if let Pigment::Picture(picture) = material.pigment {
                        match self.pictured(rays, places, i, picture.0 as usize) {
                            Some(color) => albedo *= color,
                            None => left[rays.path[i] as usize] = true,
                        }
                    }
                    for (to, x) in places.albedo.iter_mut().zip(albedo.to_array()) {
                        to[i] = x;
                    }
                    places.reflect[i] = material.reflect;
                }
            }
        }
    }

    #[inline(always)]
    fn planes<S: Simd>(&self, ray: &Ray<S::Double>, ids: &[usize; 8]) -> Place<S::Double> {
        let planes = &self.tracer.prepared.local.planes;
        let mut lanes = [[0.0; 8]; 4];
        for k in 0..8 {
            let p = &planes[ids[k]];
            (lanes[0][k], lanes[1][k], lanes[2][k], lanes[3][k]) = (p.n.x, p.n.y, p.n.z, p.h);
        }
        shade::on_plane(ray, &LocalPlane { n: three::<S>(&lanes, 0), h: S::Double::load(&lanes[3]) })
    }

    #[inline(always)]
    fn spheres<S: Simd>(
        &self,
        ray: &Ray<S::Double>,
        ids: &[usize; 8],
        inner: &[f64; 8],
        own: &[f64; 8],
    ) -> Place<S::Double> {
        let local = &self.tracer.prepared.local;
        let mut lanes = [[0.0; 8]; 4];
        for k in 0..8 {
            let s = &local.spheres[ids[k] - local.planes.len()];
            (lanes[0][k], lanes[1][k], lanes[2][k], lanes[3][k]) = (s.c.x, s.c.y, s.c.z, s.r);
        }
        let sphere = LocalSphere { c: three::<S>(&lanes, 0), r: S::Double::load(&lanes[3]) };
        shade::on_sphere(ray, &sphere, S::Double::load(inner), S::Double::load(own))
    }

    #[inline(always)]
    fn triangles<S: Simd>(&self, ray: &Ray<S::Double>, ids: &[usize; 8]) -> Place<S::Double> {
        let prepared = &self.tracer.prepared;
        let first = prepared.local.planes.len() + prepared.local.spheres.len();
        let mut lanes = [[0.0; 8]; 9];
        for k in 0..8 {
            let t = prepared.local.triangle(&prepared.scene.triangles()[ids[k] - first]);
            for (c, v) in t.v.iter().enumerate() {
                (lanes[3 * c][k], lanes[3 * c + 1][k], lanes[3 * c + 2][k]) = (v.x, v.y, v.z);
            }
        }
        let v = [three::<S>(&lanes, 0), three::<S>(&lanes, 3), three::<S>(&lanes, 6)];
        shade::on_triangle(ray, &LocalTriangle { v })
    }

    /// The picture's colour where ray `i` met it, `None` where f64 does not place it well enough.
    #[inline(never)]
    fn pictured(&self, rays: &Rays, places: &Places, i: usize, picture: usize) -> Option<DVec3> {
        let tracer = self.tracer;
        let scene = &*tracer.prepared.scene;
        let met = decision(places.met[i])?;
        let data = &scene.pictures()[picture];
        let (uv, e) =
            texture::coordinates(scene, &tracer.prepared.local, &tracer.mappings, met, &places.one(i), &rays.one(i));
        let size = f64::from(data.width().max(data.height()));
        if !(e * size <= texture::TEXEL) {
            return None;
        }
        Some(tracer.texels[picture].sample(data, uv, texture::wraps(kind(scene, met.id))))
    }

    /// Adds up the light that reaches each place.
    #[expect(clippy::too_many_arguments, reason = "the wave's parts, borrowed apart")]
    #[inline(always)]
    fn light<S: Simd>(
        &self,
        rays: &Rays,
        places: &mut Places,
        shadows: &mut Shadows,
        packet: &mut Packet,
        walk: &mut Walk,
        path: &mut PathScratch,
        left: &mut [bool],
        shadow_counts: &mut [u32],
        depth: u32,
        out: &mut [Sample],
    ) {
        let n = rays.len();
        for (k, &light) in self.tracer.prepared.local.lights.iter().enumerate() {
            let light = V3::<S::Double>::splat(light);
            shadows.at.clear();
            shadows.cosine.clear();
            for at in (0..n).step_by(8) {
                let place = Place {
                    p: load3::<S>(&places.p, at),
                    ep: load::<S>(&places.ep, at),
                    n: load3::<S>(&places.n, at),
                    en: load::<S>(&places.en, at),
                };
                let incidence = shade::incidence(&place, light, load::<S>(&rays.throughput, at));
                let fine = incidence.excess.le(S::Double::splat(0.0));
                let lit = incidence.cosine.positive();
                let mut cosines = [0.0; 8];
                incidence.cosine.store(&mut cosines);
                for lane in 0..8.min(n - at) {
                    let i = at + lane;
                    let p = rays.path[i] as usize;
                    if places.met[i] == NONE || left[p] {
                        continue;
                    }
                    if fine >> lane & 1 == 0 {
                        left[p] = true;
                        continue;
                    }
                    let dark = places.albedo[0][i] == 0.0 && places.albedo[1][i] == 0.0 && places.albedo[2][i] == 0.0;
                    if lit >> lane & 1 == 1 && !dark {
                        shadow_counts[p] += 1;
                        shadows.at.push(i as u32);
                        shadows.cosine.push(cosines[lane]);
                    }
                }
            }
            for first in (0..shadows.at.len()).step_by(LANES) {
                let list = &shadows.at[first..shadows.at.len().min(first + LANES)];
                let mut at = [list[0]; LANES];
                at[..list.len()].copy_from_slice(list);
                let low = places.towards::<S>(&at[..8], light);
                let high = places.towards::<S>(&at[8..], light);
                let near = self.fill::<S>(packet, &low, &high);
                for k in 0..LANES {
                    packet.own[k] = places.met[at[k] as usize];
                }
                let all = (((1u32 << list.len()) - 1) & 0xffff) as u16;
                packet.active = all & near;
                let mut blocked = packet::blocked::<S>(self.filter, self.wide, packet, walk);
                let mut open = all & !near;
                for d in &walk.doubts {
                    open |= 1 << d.lane;
                }
                while open != 0 {
                    let lane = open.trailing_zeros() as usize;
                    open &= open - 1;
                    let i = list[lane] as usize;
                    let candidates = walk.doubts.iter().filter(|d| usize::from(d.lane) == lane).map(|d| d.id);
                    let candidates = (near >> lane & 1 == 1).then_some(candidates);
                    match self.settle_shadow(places, i, k, candidates, path) {
                        Occluded::Yes => blocked |= 1 << lane,
                        Occluded::No => {}
                        Occluded::Doubt => left[rays.path[i] as usize] = true,
                    }
                }
                for (lane, &i) in list.iter().enumerate() {
                    if blocked >> lane & 1 == 0 {
                        let i = i as usize;
                        places.lit[i] += shadows.cosine[first + lane];
                        let signature = &mut out[rays.path[i] as usize].signature;
                        *signature ^= mix(*signature | 1, k as u64 + 1).rotate_left(depth);
                    }
                }
            }
        }
    }

    #[inline(never)]
    fn settle_shadow(
        &self,
        places: &Places,
        i: usize,
        light: usize,
        candidates: Option<impl Iterator<Item = u32>>,
        path: &mut PathScratch,
    ) -> Occluded {
        let prepared = &self.tracer.prepared;
        let place = places.one(i);
        let light = V3::splat(prepared.local.lights[light]);
        let ray = shade::towards(&place, light, light - place.p);
        let from = decision(places.met[i]);
        match candidates {
            Some(ids) => prepared.occluded_among(&ray, from, ids.map(|id| ObjectId(id & !INSIDE)), &mut path.query),
            None => prepared.occluded(&ray, from, &mut path.query),
        }
    }

    /// Adds what each place sends along its path.
    fn gather(&self, rays: &Rays, places: &Places, left: &[bool], out: &mut [Sample]) {
        for i in 0..rays.len() {
            let path = rays.path[i] as usize;
            if places.met[i] == NONE || left[path] {
                continue;
            }
            let color = DVec3::new(places.albedo[0][i], places.albedo[1][i], places.albedo[2][i]);
            if color != DVec3::ZERO {
                out[path].radiance += color * (rays.throughput[i] * places.lit[i]);
            }
        }
    }

    /// The mirrored rays of all places that mirror.
    #[inline(always)]
    fn reflect<S: Simd>(&self, rays: &Rays, places: &Places, next: &mut Rays, left: &[bool], mirrors: &mut [u32]) {
        let n = rays.len();
        for at in (0..n).step_by(8) {
            let mut any = false;
            let count = 8.min(n - at);
            for i in at..at + count {
                any |= places.met[i] != NONE && places.reflect[i] != 0.0;
            }
            if !any {
                continue;
            }
            let ray = rays.eight::<S>(at);
            let place = Place {
                p: load3::<S>(&places.p, at),
                ep: load::<S>(&places.ep, at),
                n: load3::<S>(&places.n, at),
                en: load::<S>(&places.en, at),
            };
            let mirrored = shade::reflect(&ray, &place);
            let mut lanes = [[0.0; 8]; 8];
            for (x, to) in [
                mirrored.o.x,
                mirrored.o.y,
                mirrored.o.z,
                mirrored.d.x,
                mirrored.d.y,
                mirrored.d.z,
                mirrored.eo,
                mirrored.ed,
            ]
            .into_iter()
            .zip(&mut lanes)
            {
                x.store(to);
            }
            for lane in 0..count {
                let i = at + lane;
                let path = rays.path[i] as usize;
                let throughput = rays.throughput[i] * places.reflect[i];
                if places.met[i] == NONE || left[path] || throughput == 0.0 {
                    continue;
                }
                mirrors[path] += 1;
                for k in 0..3 {
                    next.o[k].push(lanes[k][lane]);
                    next.d[k].push(lanes[3 + k][lane]);
                }
                next.eo.push(places.ep[i]);
                next.ed.push(lanes[7][lane]);
                next.own.push(places.met[i]);
                next.path.push(rays.path[i]);
                next.throughput.push(throughput);
            }
        }
    }
}

/// An object's code as a decision.
fn decision(code: u32) -> Option<Decision> {
    (code != NONE).then_some(Decision { id: ObjectId(code & !INSIDE), inside: code & INSIDE != 0 })
}

fn code(d: Decision) -> u32 {
    d.id.0 | if d.inside { INSIDE } else { 0 }
}
