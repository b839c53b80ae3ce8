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

/// Decides what a path meets: in f64, and where that leaves it open, by its refiner.
struct Decider<'a> {
    /// Whether there is one, or f64's own value decides.
    refines: bool,
    query: &'a mut Scratch,
    refiner: Refiner,
    counts: &'a mut RayCounts,
}

impl Decider<'_> {
    /// What `ray`, which starts on `from`, meets first.
    fn closest(&mut self, case: &Case<'_>, ray: &Ray, from: Option<Decision>) -> Option<Decision> {
        match case.tracer.prepared.closest(ray, from, self.query) {
            Closest::Nothing => None,
            Closest::Sure(decision) => Some(decision),
            Closest::Doubt if !self.refines => self.query.likely_closest(),
            Closest::Doubt => {
                self.counts.refined += 1;
                self.refiner.closest(case, &self.query.candidates().collect::<Vec<_>>())
            }
        }
    }

    /// Whether anything is between the point of `met` and the `k`-th light, to which `segment` leads.
    fn occluded(&mut self, case: &Case<'_>, segment: &Ray, met: Decision, k: usize) -> bool {
        match case.tracer.prepared.occluded(segment, Some(met), Some(k), self.query) {
            Occluded::No => false,
            Occluded::Yes => true,
            Occluded::Doubt if !self.refines => self.query.likely_occluded(),
            Occluded::Doubt => {
                self.counts.refined += 1;
                let candidates: Vec<_> = self.query.candidates().collect();
                self.refiner.occluded(case, met, k, &candidates)
            }
        }
    }

    /// The cosines towards the lights that reach the point of `met`, in their order.
    fn cosines(
        &mut self,
        case: &Case<'_>,
        met: Decision,
        interaction: &SurfaceInteraction,
        refined: Option<&Refined>,
        cosines: &mut Vec<f64>,
    ) {
        let prepared = &case.tracer.prepared;
        cosines.clear();
        for (k, &light) in prepared.local.lights.iter().enumerate() {
            let light = V3::splat(light);
            let incidence = shade::incidence(interaction, light);
            let cosine = match refined {
                Some(Refined { hit: Some(hit), .. }) => hit.cosines[k],
                _ => incidence.cosine,
            };
            // A light in the plane of a surface does not light it.
            let in_plane = prepared.planes_with_light(k).contains(&met.id.0)
                || (cosine > 0.0 && cosine < shade::GRAZING && prepared.has_light_in_plane(met.id, k));
            if !(cosine > 0.0) || in_plane {
                continue;
            }
            self.counts.shadow += 1;
            let segment = shade::towards(interaction, light, incidence.l);
            if !self.occluded(case, &segment, met, k) {
                cosines.push(cosine);
            }
        }
    }
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
        let refines = self.refinement == Refinement::On;
        let mut decider = Decider { refines, query, refiner: Refiner::default(), counts };
        let mut ray = self.frame.ray(point);
        let mut from: Option<Decision> = None;
        let mut throughput = 1.0;
        let mut sum = DVec3::ZERO;
        decider.counts.camera += 1;
        for depth in 1..=self.settings.max_depth {
            if self.is_unwanted() {
                break;
            }
            let case = Case { tracer: self, point, trail };
            let Some(decision) = decider.closest(&case, &ray, from) else {
                decider.counts.unresolved += u64::from(decider.refiner.unresolved());
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
            let mut refined =
                if too_wide { decider.refiner.interaction(&case, decision, throughput, goes_on) } else { None };
            let mut color = material.albedo;
            if let Pigment::Texture(picture) = material.pigment {
                let picture_data = &scene.textures()[picture.0 as usize];
                let size = f64::from(picture_data.width().max(picture_data.height()));
                let (mut uv, e) =
                    texture::coordinates(scene, &self.prepared.local, &self.mappings, decision, &interaction, &ray);
                if refines && refined.is_none() && !(e * size <= TEXEL) {
                    refined = decider.refiner.interaction(&case, decision, throughput, goes_on);
                }
                if let Some(Refined { hit: Some(hit), .. }) = &refined {
                    uv = hit.uv;
                }
                color *= self.picture_color(picture, uv, decision.id);
            }
            if let Some(refined) = &refined {
                decider.counts.refined += 1;
                interaction = refined.interaction;
            }
            if color != DVec3::ZERO {
                decider.cosines(&case, decision, &interaction, refined.as_ref(), cosines);
                let lit: f64 = cosines.iter().sum();
                let direct = color * (throughput * lit);
                sum += direct;
            }
            throughput *= material.reflect;
            if throughput == 0.0 || !goes_on {
                break;
            }
            decider.counts.mirror += 1;
            ray = match &refined {
                Some(refined) => Ray::new(interaction.p, V3::splat(refined.mirrored), interaction.ep, refined.turn),
                None => shade::reflect(&ray, &interaction),
            };
            trail.push(decision);
            from = Some(decision);
        }
        decider.counts.unresolved += u64::from(decider.refiner.unresolved());
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
