//! Radiance along one path: an iterative walk from mirror to mirror.

use glam::DVec3;

use super::arbiter::{self, Decision, ExactHit, ExactRay};
use super::camera::PlanePoint;
use super::query::{Closest, Occluded, Scratch};
use super::texture::{self, Place};
use super::{RayCounts, Sample, Tracer};
use crate::geometry::local::{Kind, kind};
use crate::geometry::{Ray, U, norm1, plane, sphere, triangle};
use crate::scene::Pigment;

/// Values whose bound exceeds this, as a share of what they can be, are taken from wide arithmetic.
const VALUE: f64 = 1.0 / (1u64 << 20) as f64;

/// A hash step (the finaliser of SplitMix64).
fn mix(hash: u64, word: u64) -> u64 {
    let x = (hash ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Memory of a thread that traces paths.
#[derive(Debug, Default)]
pub(crate) struct PathScratch {
    query: Scratch,
    trail: Vec<Decision>,
    cosines: Vec<f64>,
}

/// The path in wide arithmetic, followed only as far as it was asked about.
struct ExactPath<'a> {
    tracer: &'a Tracer,
    point: PlanePoint,
    /// Decisions followed, and the ray after them.
    at: Option<(usize, ExactRay)>,
}

impl ExactPath<'_> {
    /// The ray after all decisions of `trail`.
    fn ray(&mut self, trail: &[Decision]) -> ExactRay {
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
    fn hit(&mut self, trail: &[Decision], decision: Decision) -> ExactHit {
        arbiter::hit(&self.tracer.prepared.scene, &self.ray(trail), decision)
    }
}

impl Tracer {
    /// What is seen through `point`.
    pub(crate) fn sample(&self, point: PlanePoint, scratch: &mut PathScratch, counts: &mut RayCounts) -> Sample {
        let scene = &*self.prepared.scene;
        let PathScratch { query, trail, cosines } = scratch;
        trail.clear();
        let mut exact = ExactPath { tracer: self, point, at: None };
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
                    arbiter::closest(scene, &exact.ray(trail), query.candidates()).map(|(d, _)| d)
                }
            };
            let Some(decision) = decision else {
                return Sample { radiance: sum + self.background * throughput, signature: mix(signature, u64::MAX) };
            };
            signature = mix(signature, u64::from(decision.id.0) << 1 | u64::from(decision.inside));
            let material = &self.materials[self.prepared.surface_of(decision.id).0 as usize];
            let mut place = self.place(&ray, decision, from);
            let mut wide = self.too_wide(&place).then(|| exact.hit(trail, decision));
            let mut color = material.albedo;
            if let Pigment::Picture(picture) = material.pigment {
                let picture_data = &scene.pictures()[picture.0 as usize];
                let size = f64::from(picture_data.width().max(picture_data.height()));
                let (mut uv, e) = texture::coordinates(scene, &self.prepared.local, &self.mappings, &place, &ray);
                if wide.is_some() || !(e * size <= 1e-4) {
                    let hit = wide.get_or_insert_with(|| exact.hit(trail, decision));
                    uv = texture::exact_coordinates(scene, &self.mappings, hit);
                }
                let wrap = match kind(scene, decision.id) {
                    Kind::Sphere(_) => [true, false],
                    Kind::Plane(_) => [true, true],
                    Kind::Triangle(_) => [false, false],
                };
                color *= self.texels[picture.0 as usize].sample(picture_data, uv, wrap);
            }
            if let Some(hit) = &wide {
                counts.refined += 1;
                place.p = arbiter::to_local(&self.prepared.local, scene, &hit.p);
                place.ep = 2.0 * U * norm1(place.p);
                place.n = hit.n.to_f64();
                place.en = 2.0 * U;
            }
            if color != DVec3::ZERO {
                cosines.clear();
                for (k, &light) in self.prepared.local.lights.iter().enumerate() {
                    let l = light - place.p;
                    let cosine = match &wide {
                        Some(hit) => hit.cosine(scene.lights()[k]),
                        None => place.n.dot(l) / libm::sqrt(l.dot(l)),
                    };
                    if !(cosine > 0.0) {
                        continue;
                    }
                    counts.shadow += 1;
                    let el = (2.0 * U * (norm1(light) + norm1(l))) / libm::sqrt(l.dot(l));
                    let shadow = Ray::new(place.p, l, place.ep, el);
                    let blocked = match self.prepared.occluded(&shadow, Some(decision), query) {
                        Occluded::No => false,
                        Occluded::Yes => true,
                        Occluded::Doubt => {
                            counts.refined += 1;
                            let hit = exact.hit(trail, decision);
                            arbiter::occluded(scene, &hit.towards(scene.lights()[k]), query.candidates())
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
                    let reflected = hit.reflect(&exact.ray(trail).d);
                    let d = reflected.d.to_f64();
                    Ray::new(place.p, d, place.ep, 4.0 * U)
                }
                None => {
                    let d = ray.d - place.n * (2.0 * ray.d.dot(place.n));
                    Ray::new(place.p, d, place.ep, (ray.ed + 4.2 * place.en) * (1.0 + 1e-6) + 24.0 * U)
                }
            };
            trail.push(decision);
            from = Some(decision);
        }
        Sample { radiance: sum, signature }
    }

    /// Where `ray` meets what it is known to meet, in f64.
    fn place(&self, ray: &Ray, decision: Decision, from: Option<Decision>) -> Place {
        let local = &self.prepared.local;
        let (t, et, flat) = match kind(&self.prepared.scene, decision.id) {
            Kind::Plane(i) => {
                let plane = &local.planes[i];
                let (t, e) = plane::distance(ray, plane);
                (t, e, Some((plane.n, 4.0 * U)))
            }
            Kind::Triangle(i) => {
                let f = triangle::forms(ray, &local.triangle(&self.prepared.scene.triangles()[i]));
                let length = libm::sqrt(f.n.dot(f.n));
                // A corner moved by pos turns the normal by pos over the height on the longest side.
                (f.t, f.et, Some((f.n / length, self.tilt(&f, length))))
            }
            Kind::Sphere(i) => {
                let own = from.is_some_and(|f| f.id == decision.id);
                let (t, e) = sphere::distance(ray, &local.spheres[i], decision.inside, own);
                (t, e, None)
            }
        };
        let p = ray.o + ray.d * t;
        let travel = t.abs() * ray.len;
        let ep = et * ray.len + ray.eo + travel * ray.ed + 8.0 * U * (norm1(ray.o) + travel);
        let (n, en) = match (flat, kind(&self.prepared.scene, decision.id)) {
            (Some((n, en)), _) => (if n.dot(ray.d) > 0.0 { -n } else { n }, en),
            (None, Kind::Sphere(i)) => {
                let s = &local.spheres[i];
                let n = (p - s.c) / s.r;
                let en = (ep + 2.0 * U * norm1(s.c)) / s.r + 8.0 * U;
                (if decision.inside { -n } else { n }, en)
            }
            (None, _) => (DVec3::ZERO, f64::INFINITY),
        };
        Place { id: decision.id, inside: decision.inside, p, ep, n, en }
    }

    /// Bound on a triangle's normal: its corners are misplaced by rounding alone, not by the ray.
    fn tilt(&self, f: &triangle::Forms, length: f64) -> f64 {
        f.corner_error * f.longest * 4.0 / length + 16.0 * U * f.longest * f.longest / length
    }

    /// Whether the values at `place` may be too far from the real ones for a picture.
    fn too_wide(&self, place: &Place) -> bool {
        let lights = &self.prepared.local.lights;
        !(place.en <= VALUE)
            || lights.iter().any(|&l| {
                let d = l - place.p;
                !(place.ep * place.ep <= VALUE * VALUE * d.dot(d))
            })
    }
}
