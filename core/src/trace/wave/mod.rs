//! Many paths at once: packets find what rays meet, f64 lanes compute what is seen there.
//!
//! A wave holds the paths of a block of pixels and steps them from mirror to mirror. What a
//! packet cannot settle in f32 is settled among its few candidates in f64, and what f64 cannot
//! settle goes to the arbiter. `trace::path` traces one path by the same operations and serves
//! scenes that f32 cannot hold, and the rare path that is longer than a wave keeps.

mod lanes;
mod paths;

use glam::DVec3;

use lanes::{Places, Rays, load, scatter, three};
use paths::{Paths, decision};

use super::camera::PlanePoint;
use super::filter::Filter;
use super::packet::{self, INSIDE, NONE, Packet, U32, Walk};
use super::path::PathScratch;
use super::record::Recording;
use super::shade::{self, Place};
use super::texture;
use super::{RayCounts, Refinement, Sample, Tracer};
use crate::bvh::{Boxes, Wide};
use crate::geometry::plane::LocalPlane;
use crate::geometry::sphere::LocalSphere;
use crate::geometry::triangle::LocalTriangle;
use crate::geometry::{ObjectId, Ray, Real, U, V3};
use crate::scene::{PictureId, Pigment};
use crate::simd::{Double, Kernel, LANES, Simd, Single, prefetch};

/// The most paths of a wave.
pub(crate) const PATHS: usize = 512;
/// Steps a wave keeps; longer paths are traced alone.
const STEPS: u32 = 64;
/// Starts farther out than this are left to f64.
const FAR: f64 = 1e4;

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
    /// Per path: rays so far.
    mirrors: Vec<u32>,
    shadow_counts: Vec<u32>,
    trails: Vec<Vec<u32>>,
    pub(crate) path: PathScratch,
}

/// One wave, to be run at some level.
pub(crate) struct Wave<'a> {
    pub(crate) tracer: &'a Tracer,
    /// At most [`PATHS`].
    pub(crate) points: &'a [PlanePoint],
    /// Where paths are recorded, if they are.
    pub(crate) record: Option<Recording<'a>>,
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
            return self.run_scalar();
        };
        let WaveScratch { rays, next, places, shadows, packet, walk, kinds, mirrors, shadow_counts, trails, path } =
            self.scratch;
        let n = self.points.len();
        for v in [&mut *mirrors, &mut *shadow_counts] {
            v.clear();
            v.resize(n, 0);
        }
        self.out.fill(Sample::BLANK);
        let mut paths = Paths {
            tracer: self.tracer,
            points: self.points,
            out: &mut *self.out,
            mirrors,
            shadows: shadow_counts,
            trails,
            query: &mut path.query,
            courts: Vec::new(),
            refined_places: Vec::new(),
            refined: 0,
            step: 0,
            record: self.record,
        };
        let stage = Stage { tracer: self.tracer, filter, wide };
        stage.camera::<S>(self.points, rays);
        let max_depth = self.tracer.settings.max_depth;
        for depth in 1..=max_depth.min(STEPS) {
            if rays.len() == 0 {
                break;
            }
            paths.step = depth as usize - 1;
            paths.refined_places.clear();
            places.reset(rays.len().next_multiple_of(LANES));
            stage.closest::<S>(rays, places, packet, walk, &mut paths);
            stage.places::<S>(rays, places, kinds, &mut paths);
            stage.record(rays, places, &mut paths);
            stage.light::<S>(rays, places, shadows, packet, walk, &mut paths);
            stage.gather(rays, places, &mut paths);
            next.clear();
            if self.tracer.mirrors && (depth < max_depth || paths.record.is_some()) {
                stage.reflect::<S>(rays, places, next, &mut paths, depth < max_depth);
            }
            std::mem::swap(rays, next);
        }
        self.counts.camera += n as u64;
        self.counts.refined += paths.refined;
        let unresolved = paths.unresolved();
        self.counts.unresolved += unresolved.iter().filter(|u| **u).count() as u64;
        self.counts.mirror += paths.mirrors.iter().map(|&n| u64::from(n)).sum::<u64>();
        self.counts.shadow += paths.shadows.iter().map(|&n| u64::from(n)).sum::<u64>();
        // Rays are left only where a wave keeps fewer steps than the paths may have.
        let mut record = paths.record;
        for &k in &rays.path {
            let k = k as usize;
            self.counts.camera -= 1;
            self.counts.unresolved -= u64::from(unresolved.get(k).is_some_and(|u| *u));
            self.counts.mirror -= u64::from(mirrors[k]);
            self.counts.shadow -= u64::from(shadow_counts[k]);
            self.out[k] = self.tracer.sample(self.points[k], path, self.counts, record.as_mut().map(|r| (r, k)));
        }
    }

    fn run_scalar(mut self) {
        for (k, (p, out)) in self.points.iter().zip(self.out).enumerate() {
            *out = self.tracer.sample(*p, &mut self.scratch.path, self.counts, self.record.as_mut().map(|r| (r, k)));
        }
    }
}

struct Stage<'a> {
    tracer: &'a Tracer,
    filter: &'a Filter,
    wide: &'a Wide<f32>,
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
        let up = s(1.0 + 8.0 * U32);
        let eo = S::narrow(low.eo, high.eo) * up;
        let ed = S::narrow(low.ed, high.ed) * up;
        let (x, y, z) = (S::narrow(low.o.x, high.o.x), S::narrow(low.o.y, high.o.y), S::narrow(low.o.z, high.o.z));
        let far = (x * x + y * y + z * z).sqrt() * up;
        ed.store(&mut packet.ed);
        let turn = ed * s(1.1) + s(10.0 * U32);
        ((eo + far * (turn + s(2.0 * U32))) * up).store(&mut packet.near);
        (turn * up).store(&mut packet.per);
        ((eo + turn * (far + s(self.filter.reach))) * s(1.1)).store(&mut packet.pad);
        // Squares of lengths that f32 holds to its full precision.
        let (x, y, z) = (S::narrow(low.d.x, high.d.x), S::narrow(low.d.y, high.d.y), S::narrow(low.d.z, high.d.z));
        let dd = x * x + y * y + z * z;
        far.lt(s(FAR as f32)) & s(1e-30).lt(dd) & dd.lt(s(1e30))
    }

    #[inline(always)]
    fn closest<S: Simd>(
        &self,
        rays: &Rays,
        places: &mut Places,
        packet: &mut Packet,
        walk: &mut Walk,
        paths: &mut Paths,
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
            self.expect(&walk.best);
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
                paths.settle(rays, at + lane, candidates, places);
            }
        }
    }

    /// Asks memory for the triangles that will be shaded.
    #[inline(always)]
    fn expect(&self, met: &[u32; LANES]) {
        let scene = &self.tracer.prepared.scene;
        let first = (scene.planes().len() + scene.spheres().len()) as u32;
        for id in met {
            prefetch(scene.triangles(), (id & !INSIDE).wrapping_sub(first) as usize, 1);
        }
    }

    /// Computes where rays meet what they are known to meet; what met nothing sees the background.
    #[inline(always)]
    fn places<S: Simd>(&self, rays: &Rays, places: &mut Places, kinds: &mut [Vec<u32>; 3], paths: &mut Paths) {
        let tracer = self.tracer;
        let local = &tracer.prepared.local;
        for k in kinds.iter_mut() {
            k.clear();
        }
        let planes = local.planes.len() as u32;
        let spheres = planes + local.spheres.len() as u32;
        for i in 0..rays.len() {
            let id = places.met[i];
            let seen = &mut paths.out[rays.path[i] as usize];
            if id == NONE {
                seen.radiance += tracer.background * rays.throughput[i];
                continue;
            }
            let bare = id & !INSIDE;
            kinds[usize::from(bare >= planes) + usize::from(bare >= spheres)].push(i as u32);
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
                for (&i, id) in at.iter().zip(ids) {
                    let i = i as usize;
                    let material = tracer.material(ObjectId(id as u32));
                    let mut albedo = material.albedo;
                    if let Pigment::Picture(picture) = material.pigment {
                        match self.pictured(rays, places, i, picture) {
                            Some(color) => albedo *= color,
                            // Too unsure of its place: not a number here, refined below.
                            None => places.en[i] = f64::INFINITY,
                        }
                    }
                    for (to, x) in places.albedo.iter_mut().zip(albedo.to_array()) {
                        to[i] = x;
                    }
                    places.reflect[i] = material.reflect;
                }
            }
        }
        self.refine::<S>(rays, places, paths);
    }

    /// Finds the places that f64 does not know well enough, and takes them from wide arithmetic.
    #[inline(always)]
    fn refine<S: Simd>(&self, rays: &Rays, places: &mut Places, paths: &mut Paths) {
        for at in (0..rays.len()).step_by(8) {
            let place = places.eight::<S>(at);
            let mut nearest = S::Double::splat(f64::INFINITY);
            for &light in &self.tracer.prepared.local.lights {
                nearest = shade::nearer(nearest, &place, V3::splat(light));
            }
            let excess = shade::excess(&place, nearest, load::<S>(&rays.throughput, at));
            let fine = excess.le(S::Double::splat(0.0));
            if fine != 0xff {
                for lane in 0..8.min(rays.len() - at) {
                    if fine >> lane & 1 == 0 {
                        paths.refine(rays, places, at + lane);
                    }
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
    fn pictured(&self, rays: &Rays, places: &Places, i: usize, picture: PictureId) -> Option<DVec3> {
        let tracer = self.tracer;
        let scene = &*tracer.prepared.scene;
        let met = decision(places.met[i])?;
        let (place, ray) = (places.one(i), rays.one(i));
        let (uv, e) = texture::coordinates(scene, &tracer.prepared.local, &tracer.mappings, met, &place, &ray);
        let data = &scene.pictures()[picture.0 as usize];
        let size = f64::from(data.width().max(data.height()));
        let fine = e * size <= texture::TEXEL || tracer.refinement == Refinement::Off;
        fine.then(|| tracer.picture_color(picture, uv, met.id))
    }

    /// Records what each ray met.
    fn record(&self, rays: &Rays, places: &Places, paths: &mut Paths) {
        let Some(record) = &mut paths.record else { return };
        let depth = paths.step as u32 + 1;
        for i in 0..rays.len() {
            let (path, throughput) = (rays.path[i] as usize, rays.throughput[i]);
            if places.met[i] == NONE {
                let nowhere = || (DVec3::ZERO, DVec3::ZERO);
                record.meet(path, depth, NONE, nowhere, self.tracer.background * throughput);
                continue;
            }
            let albedo = DVec3::new(places.albedo[0][i], places.albedo[1][i], places.albedo[2][i]);
            let at = || {
                let place = places.one(i);
                (place.p.to_dvec3(), place.n.to_dvec3())
            };
            record.meet(path, depth, places.met[i], at, albedo * throughput);
        }
    }

    /// Adds up the light that reaches each place.
    #[inline(always)]
    fn light<S: Simd>(
        &self,
        rays: &Rays,
        places: &mut Places,
        shadows: &mut Shadows,
        packet: &mut Packet,
        walk: &mut Walk,
        paths: &mut Paths,
    ) {
        let n = rays.len();
        let scene = &self.tracer.prepared.scene;
        let depth = paths.step as u32 + 1;
        let any = paths.record.as_ref().and_then(|r| r.any_lights(&rays.path, depth));
        for (k, &light) in self.tracer.prepared.local.lights.iter().enumerate() {
            if any.as_ref().is_some_and(|any| any[k / 64] >> (k % 64) & 1 == 0) {
                continue;
            }
            let light = V3::<S::Double>::splat(light);
            shadows.at.clear();
            shadows.cosine.clear();
            for at in (0..n).step_by(8) {
                let incidence = shade::incidence(&places.eight::<S>(at), light);
                let mut lit = incidence.cosine.positive();
                let mut cosines = [0.0; 8];
                incidence.cosine.store(&mut cosines);
                for lane in 0..8.min(n - at) {
                    let i = at + lane;
                    if places.refined[i] != 0
                        && let Some(hit) = &paths.refined_places[places.refined[i] as usize - 1].hit
                    {
                        cosines[lane] = hit.cosine(scene.lights()[k]);
                        lit = lit & !(1 << lane) | u8::from(cosines[lane] > 0.0) << lane;
                    }
                    if lit >> lane & 1 == 0 || places.met[i] == NONE {
                        continue;
                    }
                    if paths.record.as_ref().is_some_and(|r| !r.looks_for(rays.path[i] as usize, depth, k as u32)) {
                        continue;
                    }
                    if places.albedo[0][i] != 0.0 || places.albedo[1][i] != 0.0 || places.albedo[2][i] != 0.0 {
                        paths.shadows[rays.path[i] as usize] += 1;
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
                    if paths.settle_shadow(rays, places, i, k, candidates) {
                        blocked |= 1 << lane;
                    }
                }
                for (lane, &i) in list.iter().enumerate() {
                    if blocked >> lane & 1 == 0 {
                        let i = i as usize;
                        places.lit[i] += shadows.cosine[first + lane];
                        if let Some(r) = &mut paths.record {
                            r.see(rays.path[i] as usize, k);
                        }
                    }
                }
            }
        }
    }

    /// Adds what each place sends along its path.
    fn gather(&self, rays: &Rays, places: &Places, paths: &mut Paths) {
        for i in 0..rays.len() {
            if places.met[i] == NONE {
                continue;
            }
            let color = DVec3::new(places.albedo[0][i], places.albedo[1][i], places.albedo[2][i]);
            if color != DVec3::ZERO {
                let direct = color * (rays.throughput[i] * places.lit[i]);
                paths.out[rays.path[i] as usize].radiance += direct;
                if let Some(r) = &mut paths.record {
                    r.add(rays.path[i] as usize, direct);
                }
            }
        }
    }

    /// The mirrored rays of all places that mirror, lost unless the path goes `deeper`.
    #[inline(always)]
    fn reflect<S: Simd>(&self, rays: &Rays, places: &Places, next: &mut Rays, paths: &mut Paths, deeper: bool) {
        let n = rays.len();
        if paths.trails.len() <= paths.step {
            paths.trails.push(Vec::new());
        }
        let step = paths.step;
        paths.trails[step].resize(PATHS, NONE);
        for at in (0..n).step_by(8) {
            let count = 8.min(n - at);
            if (at..at + count).all(|i| places.reflect[i] == 0.0) {
                continue;
            }
            let mirrored = shade::reflect(&rays.eight::<S>(at), &places.eight::<S>(at));
            let mut lanes = [[0.0; 8]; 4];
            mirrored.d.x.store(&mut lanes[0]);
            mirrored.d.y.store(&mut lanes[1]);
            mirrored.d.z.store(&mut lanes[2]);
            mirrored.ed.store(&mut lanes[3]);
            for lane in 0..count {
                let i = at + lane;
                let path = rays.path[i] as usize;
                let throughput = rays.throughput[i] * places.reflect[i];
                if throughput == 0.0 || places.met[i] == NONE {
                    continue;
                }
                if let Some(r) = &mut paths.record {
                    if !deeper || throughput < r.least {
                        r.lose(path, throughput);
                        continue;
                    }
                    if !r.goes_beyond(path, step as u32 + 1) {
                        continue;
                    }
                }
                paths.mirrors[path] += 1;
                let (mut d, mut ed) = ([lanes[0][lane], lanes[1][lane], lanes[2][lane]], lanes[3][lane]);
                if self.tracer.refinement == Refinement::Off && places.en[i] == shade::TAKEN {
                    ed = 4.0 * U;
                }
                if places.refined[i] != 0 {
                    d = paths.refined_places[places.refined[i] as usize - 1].mirrored.to_array();
                    ed = 4.0 * U;
                }
                for k in 0..3 {
                    next.o[k].push(places.p[k][i]);
                    next.d[k].push(d[k]);
                }
                next.eo.push(places.ep[i]);
                next.ed.push(ed);
                next.own.push(places.met[i]);
                next.path.push(rays.path[i]);
                next.throughput.push(throughput);
                paths.trails[step][path] = places.met[i];
            }
        }
    }
}
