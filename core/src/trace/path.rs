//! Radiance along one path: an iterative walk from mirror to mirror.

use glam::DVec3;

use super::arbiter::{self, Decision, ExactHit, ExactRay, FIRST, LAST};
use super::camera::PlanePoint;
use super::query::{Closest, Occluded, Scratch};
use super::shade::{self, Place};
use super::texture;
use super::{RayCounts, Sample, Tracer};
use crate::geometry::local::{Kind, kind};
use crate::geometry::{Ray, U, V3};
use crate::scene::{Pigment, Scene};

/// A hash step (the finaliser of SplitMix64).
pub(crate) fn mix(hash: u64, word: u64) -> u64 {
    let x = (hash ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Memory of a thread that traces paths.
#[derive(Debug, Default)]
pub(crate) struct PathScratch {
    pub(crate) query: Scratch,
    trail: Vec<Decision>,
    cosines: Vec<f64>,
}

/// The path in wide arithmetic, followed only as far as it was asked about.
struct ExactPath<'a, const N: usize> {
    tracer: &'a Tracer,
    point: PlanePoint,
    /// Decisions followed, and the ray after them.
    at: Option<(usize, ExactRay<N>)>,
}

impl<'a, const N: usize> ExactPath<'a, N> {
    fn new(tracer: &'a Tracer, point: PlanePoint) -> Self {
        Self { tracer, point, at: None }
    }

    /// The ray after all decisions of `trail`.
    fn ray(&mut self, trail: &[Decision]) -> ExactRay<N> {
        let (mut done, mut ray) = self.at.unwrap_or_else(|| (0, self.tracer.frame.exact_ray(self.point)));
        let scene = &self.tracer.prepared.scene;
        for &decision in &trail[done..] {
            ray = arbiter::hit(scene, &ray, decision).reflect(&ray.d);
            done += 1;
        }
        self.at = Some((done, ray));
        ray
    }

    /// The point met by the ray after all decisions of `trail`.
    fn hit(&mut self, trail: &[Decision], decision: Decision) -> ExactHit<N> {
        arbiter::hit(&self.tracer.prepared.scene, &self.ray(trail), decision)
    }
}

/// Mirrors that a path in the first width may have behind it: each can cost it several bits.
const SHORT: usize = 8;

/// The path at both widths.
struct Court<'a> {
    first: ExactPath<'a, FIRST>,
    last: ExactPath<'a, LAST>,
}

impl<'a> Court<'a> {
    fn new(tracer: &'a Tracer, point: PlanePoint) -> Self {
        Self { first: ExactPath::new(tracer, point), last: ExactPath::new(tracer, point) }
    }

    fn closest(&mut self, scene: &Scene, trail: &[Decision], candidates: &Scratch) -> Option<Decision> {
        if trail.len() <= SHORT
            && let Ok(found) = arbiter::closest(scene, &self.first.ray(trail), candidates.candidates())
        {
            return found.map(|(d, _)| d);
        }
        let ray = self.last.ray(trail);
        arbiter::closest(scene, &ray, candidates.candidates()).ok().flatten().map(|(d, _)| d)
    }

    fn occluded(
        &mut self,
        scene: &Scene,
        trail: &[Decision],
        decision: Decision,
        light: DVec3,
        candidates: &Scratch,
    ) -> bool {
        if trail.len() <= SHORT {
            let segment = self.first.hit(trail, decision).towards(light);
            if let Ok(occluded) = arbiter::occluded(scene, &segment, candidates.candidates()) {
                return occluded;
            }
        }
        let segment = self.last.hit(trail, decision).towards(light);
        arbiter::occluded(scene, &segment, candidates.candidates()).unwrap_or(false)
    }

    /// The point met, and the ray that met it.
    fn hit(&mut self, trail: &[Decision], decision: Decision) -> ExactHit<LAST> {
        if trail.len() <= SHORT { self.first.hit(trail, decision).resize() } else { self.last.hit(trail, decision) }
    }

    /// The direction mirrored at `hit`, met after `trail`.
    fn mirrored(&mut self, trail: &[Decision], hit: &ExactHit<LAST>) -> DVec3 {
        if trail.len() <= SHORT {
            hit.resize::<FIRST>().reflect(&self.first.ray(trail).d).d.to_f64()
        } else {
            hit.reflect(&self.last.ray(trail).d).d.to_f64()
        }
    }
}

impl Tracer {
    /// What is seen through `point`.
    pub(crate) fn sample(&self, point: PlanePoint, scratch: &mut PathScratch, counts: &mut RayCounts) -> Sample {
        let scene = &*self.prepared.scene;
        let PathScratch { query, trail, cosines } = scratch;
        trail.clear();
        let mut exact = Court::new(self, point);
        let mut ray = self.frame.ray(point);
        let mut from: Option<Decision> = None;
        let mut throughput = 1.0;
        let mut sum = DVec3::ZERO;
        let mut signature = 0;
        counts.camera += 1;
        for depth in 1..=self.settings.max_depth {
            let decision = match self.prepared.closest(&ray, from, query) {
                Closest::Nothing => None,
                Closest::Sure(decision) => Some(decision),
                Closest::Doubt => {
                    counts.refined += 1;
                    exact.closest(scene, trail, query)
                }
            };
            let Some(decision) = decision else {
                return Sample { radiance: sum + self.background * throughput, signature: mix(signature, u64::MAX) };
            };
            signature = mix(signature, u64::from(decision.id.0) << 1 | u64::from(decision.inside));
            let material = &self.materials[self.prepared.surface_of(decision.id).0 as usize];
            let mut place = self.place(&ray, decision, from);
            let mut wide = self.too_wide(&place, throughput).then(|| exact.hit(trail, decision));
            let mut color = material.albedo;
            if let Pigment::Picture(picture) = material.pigment {
                let picture_data = &scene.pictures()[picture.0 as usize];
                let size = f64::from(picture_data.width().max(picture_data.height()));
                let (mut uv, e) =
                    texture::coordinates(scene, &self.prepared.local, &self.mappings, decision, &place, &ray);
                if wide.is_some() || !(e * size <= texture::TEXEL) {
                    let hit = wide.get_or_insert_with(|| exact.hit(trail, decision));
                    uv = texture::exact_coordinates(scene, &self.mappings, hit);
                }
                let wrap = texture::wraps(kind(scene, decision.id));
                color *= self.texels[picture.0 as usize].sample(picture_data, uv, wrap);
            }
            if let Some(hit) = &wide {
                counts.refined += 1;
                let p = V3::splat(arbiter::to_local(&self.prepared.local, scene, &hit.p));
                place = Place { p, ep: 2.0 * U * p.norm1(), n: V3::splat(hit.normal()), en: 2.0 * U };
            }
            if color != DVec3::ZERO {
                cosines.clear();
                for (k, &light) in self.prepared.local.lights.iter().enumerate() {
                    let light = V3::splat(light);
                    let incidence = shade::incidence(&place, light, throughput);
                    let cosine = match &wide {
                        Some(hit) => hit.cosine(scene.lights()[k]),
                        None => incidence.cosine,
                    };
                    if !(cosine > 0.0) {
                        continue;
                    }
                    counts.shadow += 1;
                    let shadow = shade::towards(&place, light, incidence.l);
                    let blocked = match self.prepared.occluded(&shadow, Some(decision), query) {
                        Occluded::No => false,
                        Occluded::Yes => true,
                        Occluded::Doubt => {
                            counts.refined += 1;
                            exact.occluded(scene, trail, decision, scene.lights()[k], query)
                        }
                    };
                    if !blocked {
                        cosines.push(cosine);
                        signature ^= mix(signature | 1, k as u64 + 1).rotate_left(depth);
                    }
                }
                let lit: f64 = cosines.iter().sum();
                sum += color * (throughput * lit);
            }
            throughput *= material.reflect;
            if throughput == 0.0 || depth == self.settings.max_depth {
                break;
            }
            counts.mirror += 1;
            ray = match &wide {
                Some(hit) => {
                    let d = exact.mirrored(trail, hit);
                    Ray::new(place.p, V3::splat(d), place.ep, 4.0 * U)
                }
                None => shade::reflect(&ray, &place),
            };
            trail.push(decision);
            from = Some(decision);
        }
        Sample { radiance: sum, signature }
    }

    /// Where `ray` meets what it is known to meet, in f64.
    fn place(&self, ray: &Ray, decision: Decision, from: Option<Decision>) -> Place {
        let local = &self.prepared.local;
        match kind(&self.prepared.scene, decision.id) {
            Kind::Plane(i) => shade::on_plane(ray, &local.planes[i]),
            Kind::Triangle(i) => shade::on_triangle(ray, &local.triangle(&self.prepared.scene.triangles()[i])),
            Kind::Sphere(i) => {
                let flag = |b: bool| if b { 1.0 } else { 0.0 };
                let own = from.is_some_and(|f| f.id == decision.id);
                shade::on_sphere(ray, &local.spheres[i], flag(decision.inside), flag(own))
            }
        }
    }

    /// Whether the values at `place` may be too far from the real ones for a picture.
    fn too_wide(&self, place: &Place, throughput: f64) -> bool {
        let excess = |&l: &DVec3| shade::incidence(place, V3::splat(l), throughput).excess;
        !(place.en <= shade::NORMAL) || self.prepared.local.lights.iter().any(|l| !(excess(l) <= 0.0))
    }
}
