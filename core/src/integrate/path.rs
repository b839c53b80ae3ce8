//! Radiance along one path: an iterative walk from mirror to mirror.

use glam::DVec3;

use super::refine::{Case, Refined, Refiner};
use super::shade;
use super::texels::TEXEL;
use super::{RayCounts, Refinement, Sample, Tracer};
use crate::film::PlanePoint;
use crate::numeric::{U, V3};
use crate::scene::Pigment;
use crate::shapes::{Decision, Ray, SurfaceInteraction, interaction, texture};
use crate::traverse::{Closest, Occluded, Scratch};

/// Memory of a thread that traces paths.
#[derive(Debug, Default)]
pub(crate) struct PathScratch {
    pub(crate) query: Scratch,
    trail: Vec<Decision>,
    cosines: Vec<f64>,
}

impl Tracer {
    /// What is seen through `point`, by rays of more weight than `least`.
    pub(crate) fn sample(
        &self,
        point: PlanePoint,
        least: f64,
        scratch: &mut PathScratch,
        counts: &mut RayCounts,
    ) -> Sample {
        let scene = &*self.prepared.scene;
        let PathScratch { query, trail, cosines } = scratch;
        trail.clear();
        let mut refiner = Refiner::default();
        let refines = self.refinement == Refinement::On;
        let mut ray = self.frame.ray(point);
        let mut from: Option<Decision> = None;
        let mut throughput = 1.0;
        let mut sum = DVec3::ZERO;
        counts.camera += 1;
        for depth in 1..=self.settings.max_depth {
            if self.is_unwanted() {
                break;
            }
            let case = Case { tracer: self, point, trail };
            let decision = match self.prepared.closest(&ray, from, query) {
                Closest::Nothing => None,
                Closest::Sure(decision) => Some(decision),
                Closest::Doubt if !refines => query.likely_closest(),
                Closest::Doubt => {
                    counts.refined += 1;
                    refiner.closest(&case, &query.candidates().collect::<Vec<_>>())
                }
            };
            let Some(decision) = decision else {
                counts.unresolved += u64::from(refiner.unresolved());
                let background = self.background * throughput;
                return Sample { radiance: sum + background };
            };
            let material = self.material(decision.id);
            let mut interaction = interaction(&self.prepared.scene, &self.prepared.local, &ray, decision, from);
            let goes_on = material.reflect * throughput - least > 0.0 && depth < self.settings.max_depth;
            let mut too_wide = refines && self.too_wide(&interaction, throughput);
            if too_wide && let Some(better) = self.giant_interaction(&ray, decision, from, throughput) {
                (interaction, too_wide) = (better, false);
            }
            if !refines && self.too_wide(&interaction, throughput) {
                interaction = interaction.taken_as_it_is();
                ray.ed = 4.0 * U;
            }
            let mut refined = if too_wide { refiner.interaction(&case, decision, throughput, goes_on) } else { None };
            let mut color = material.albedo;
            if let Pigment::Texture(picture) = material.pigment {
                let picture_data = &scene.textures()[picture.0 as usize];
                let size = f64::from(picture_data.width().max(picture_data.height()));
                let (mut uv, e) =
                    texture::coordinates(scene, &self.prepared.local, &self.mappings, decision, &interaction, &ray);
                if refines && refined.is_none() && !(e * size <= TEXEL) {
                    refined = refiner.interaction(&case, decision, throughput, goes_on);
                }
                if let Some(Refined { hit: Some(hit), .. }) = &refined {
                    uv = hit.uv;
                }
                color *= self.picture_color(picture, uv, decision.id);
            }
            if let Some(refined) = &refined {
                counts.refined += 1;
                interaction = refined.interaction;
            }
            if color != DVec3::ZERO {
                cosines.clear();
                for (k, &light) in self.prepared.local.lights.iter().enumerate() {
                    let light = V3::splat(light);
                    let incidence = shade::incidence(&interaction, light);
                    let cosine = match &refined {
                        Some(Refined { hit: Some(hit), .. }) => hit.cosines[k],
                        _ => incidence.cosine,
                    };
                    // A light in the plane of a surface does not light it.
                    let in_plane = self.prepared.planes_with_light(k).contains(&decision.id.0);
                    if !(cosine > 0.0) || in_plane {
                        continue;
                    }
                    counts.shadow += 1;
                    let shadow = shade::towards(&interaction, light, incidence.l);
                    let blocked = match self.prepared.occluded(&shadow, Some(decision), Some(k), query) {
                        Occluded::No => false,
                        Occluded::Yes => true,
                        Occluded::Doubt if !refines => query.likely_occluded(),
                        Occluded::Doubt => {
                            counts.refined += 1;
                            let candidates: Vec<_> = query.candidates().collect();
                            refiner.occluded(&case, decision, k, &candidates)
                        }
                    };
                    if !blocked {
                        cosines.push(cosine);
                    }
                }
                let lit: f64 = cosines.iter().sum();
                let direct = color * (throughput * lit);
                sum += direct;
            }
            throughput *= material.reflect;
            if throughput == 0.0 {
                break;
            }
            if !goes_on {
                break;
            }
            counts.mirror += 1;
            ray = match &refined {
                Some(refined) => Ray::new(interaction.p, V3::splat(refined.mirrored), interaction.ep, refined.turn),
                None => shade::reflect(&ray, &interaction),
            };
            trail.push(decision);
            from = Some(decision);
        }
        counts.unresolved += u64::from(refiner.unresolved());
        Sample { radiance: sum }
    }

    /// Where `ray` meets a giant that is not pictured, as it is described around the eye: if that is right to nearly
    /// the last digits, as what else would be asked for this place is.
    pub(super) fn giant_interaction(
        &self,
        ray: &Ray,
        met: Decision,
        from: Option<Decision>,
        throughput: f64,
    ) -> Option<SurfaceInteraction> {
        let interaction = self.prepared.giants.interaction(ray, met, from)?;
        let tight = interaction.ep <= 256.0 * U * interaction.p.norm1() && interaction.en <= 256.0 * U;
        (tight && !self.is_pictured(met.id.0) && !self.too_wide(&interaction, throughput)).then_some(interaction)
    }

    /// Whether the values at `place` may be too far from the real ones for a picture.
    pub(super) fn too_wide(&self, interaction: &SurfaceInteraction, throughput: f64) -> bool {
        let lights = &self.prepared.local.lights;
        let first = self.prepared.local.nearest_light_at_first();
        let nearest = lights.iter().fold(first, |d, &l| shade::nearer(d, interaction, V3::splat(l)));
        !(shade::excess(interaction, nearest, throughput) <= 0.0)
    }
}
