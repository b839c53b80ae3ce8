//! What a wave keeps of each path, and its way to wide arithmetic.

use glam::DVec3;

use crate::film::PlanePoint;
use crate::integrate::refine::{Case, Refined, Refiner, Start};
use crate::integrate::{RayCounts, Refinement, Tracer};
use crate::numeric::U;
use crate::scene::Pigment;
use crate::shapes::{Decision, INSIDE, NONE, ObjectId, TAKEN};
use crate::traverse::{Closest, Occluded, Scratch};

use super::STEPS;
use super::lanes::{Column, Rays, SurfaceInteractions};

/// The paths of one wave.
pub(super) struct Paths<'a> {
    pub(super) tracer: &'a Tracer,
    pub(super) points: &'a [PlanePoint],
    /// The light each path has gathered.
    pub(super) radiance: &'a mut [Column<f64>; 3],
    /// Rays of all of them.
    pub(super) counts: RayCounts,
    /// What each path met, per step; of the first steps alone.
    pub(super) trails: &'a mut Vec<Column<u32>>,
    /// The few paths that are followed farther, and what each has met so far.
    pub(super) far: Vec<(u32, Vec<Decision>)>,
    pub(super) query: &'a mut Scratch,
    /// Wide arithmetic of the paths that needed it; empty until one does.
    pub(super) refiners: Vec<Option<Box<Refiner>>>,
    /// Surface interactions of this step that f64 alone would misplace.
    pub(super) refined_interactions: Vec<Refined>,
    /// Mirrors behind the rays of this step.
    pub(super) step: usize,
    /// Mirrored rays of no more weight are not followed.
    pub(super) least: f64,
}

impl Paths<'_> {
    /// Adds light to what `path` has gathered.
    #[inline(always)]
    pub(super) fn shine(&mut self, path: usize, light: DVec3) {
        for (sum, x) in self.radiance.iter_mut().zip(light.to_array()) {
            sum[path] += x;
        }
    }

    /// Puts what wide arithmetic knows of the cosines towards `light` at places `at` to `at` + 8.
    #[inline(never)]
    pub(super) fn wide_cosines(
        &self,
        interactions: &SurfaceInteractions,
        at: usize,
        light: usize,
        cosines: &mut [f64; 8],
    ) {
        for (lane, cosine) in cosines.iter_mut().enumerate() {
            let refined = interactions.refined[at + lane] as usize;
            if refined != 0
                && let Some(hit) = &self.refined_interactions[refined - 1].hit
            {
                *cosine = hit.cosines[light];
            }
        }
    }

    /// Puts what wide arithmetic knows of the ray mirrored at place `i` into its lane of d and ed.
    #[inline(never)]
    pub(super) fn mirrored(
        &self,
        interactions: &SurfaceInteractions,
        i: usize,
        lane: usize,
        lanes: &mut [[f64; 8]; 4],
    ) {
        if self.tracer.refinement == Refinement::Off && interactions.en[i] == TAKEN {
            lanes[3][lane] = 4.0 * U;
        }
        if interactions.refined[i] != 0 {
            let Refined { mirrored: d, turn, .. } = self.refined_interactions[interactions.refined[i] as usize - 1];
            (lanes[0][lane], lanes[1][lane], lanes[2][lane], lanes[3][lane]) = (d.x, d.y, d.z, turn);
        }
    }

    /// Notes what `path` met in this step.
    #[inline(always)]
    pub(super) fn note(&mut self, path: u32, met: u32) {
        if self.step < STEPS as usize {
            self.trails[self.step][path as usize] = met;
        } else {
            self.note_far(path, met);
        }
    }

    #[inline(never)]
    fn note_far(&mut self, path: u32, met: u32) {
        let trail = self.far.iter_mut().find(|(of, _)| *of == path);
        if let (Some((_, trail)), Some(met)) = (trail, Decision::of(met)) {
            trail.push(met);
        }
    }

    /// What `path` met in the first steps.
    fn met(&self, path: usize, steps: usize) -> Vec<Decision> {
        self.trails[..steps].iter().filter_map(|met| Decision::of(met[path])).collect()
    }

    /// From now on, some paths go beyond the first steps.
    pub(super) fn go_far(&mut self, some: &[u32]) {
        self.far = some.iter().map(|&path| (path, self.met(path as usize, STEPS as usize))).collect();
    }

    /// Puts a question about ray `i` to its path's refiner, with what that path met before this step.
    fn ask<A>(&mut self, rays: &Rays, i: usize, question: impl FnOnce(&mut Refiner, &Case<'_>) -> A) -> A {
        self.counts.refined += 1;
        let (tracer, path) = (self.tracer, rays.path[i] as usize);
        if tracer.is_given(rays.throughput[i]) {
            let start = Start::Given(rays.one(i), Decision::of(rays.own[i]));
            return question(&mut Refiner::default(), &Case { tracer, start, trail: &[] });
        }
        if self.refiners.is_empty() {
            self.refiners.resize_with(self.points.len(), || None);
        }
        let near;
        let trail = match self.far.iter().find(|(of, _)| *of as usize == path) {
            Some((_, trail)) => trail,
            None => {
                near = self.met(path, self.step);
                &near
            }
        };
        let case = Case { tracer, start: Start::Camera(self.points[path]), trail };
        question(self.refiners[path].get_or_insert_default(), &case)
    }

    /// Of how many paths something stayed open in the widest numbers.
    pub(super) fn unresolved(&self) -> u64 {
        self.refiners.iter().flatten().filter(|r| r.unresolved()).count() as u64
    }

    /// Decides what ray `i` meets: in f64 among `candidates`, or all objects, and if need be beyond.
    #[inline(never)]
    pub(super) fn settle(
        &mut self,
        rays: &Rays,
        i: usize,
        candidates: Option<impl Iterator<Item = u32>>,
        interactions: &mut SurfaceInteractions,
    ) {
        let prepared = &self.tracer.prepared;
        let (ray, from) = (rays.one(i), Decision::of(rays.own[i]));
        let found = match candidates {
            Some(ids) => prepared.closest_among(&ray, from, ids.map(|id| ObjectId(id & !INSIDE)), self.query),
            None => prepared.closest(&ray, from, self.query),
        };
        interactions.met[i] = match found {
            Closest::Nothing => NONE,
            Closest::Sure(d) => d.code(),
            Closest::Doubt if self.tracer.refinement == Refinement::Off => {
                self.query.likely_closest().map_or(NONE, Decision::code)
            }
            Closest::Doubt => {
                let candidates: Vec<_> = self.query.candidates().collect();
                let found = self.ask(rays, i, |refiner, case| refiner.closest(case, &candidates));
                found.map_or(NONE, Decision::code)
            }
        };
    }

    /// Decides whether place `i` is in the shadow of `light`, as [`Self::settle`] does.
    #[inline(never)]
    pub(super) fn settle_shadow(
        &mut self,
        rays: &Rays,
        interactions: &SurfaceInteractions,
        i: usize,
        light: usize,
        candidates: Option<impl Iterator<Item = u32>>,
    ) -> bool {
        let prepared = &self.tracer.prepared;
        let ray = interactions.segment(i, self.tracer, light);
        let met = Decision::of(interactions.met[i]);
        let occluded = match candidates {
            Some(ids) => {
                let ids = ids.map(|id| ObjectId(id & !INSIDE));
                prepared.occluded_among(&ray, met, Some(light), ids, self.query)
            }
            None => prepared.occluded(&ray, met, Some(light), self.query),
        };
        match (occluded, met) {
            (Occluded::No, _) | (_, None) => false,
            (Occluded::Yes, _) => true,
            (Occluded::Doubt, _) if self.tracer.refinement == Refinement::Off => self.query.likely_occluded(),
            (Occluded::Doubt, Some(met)) => {
                let candidates: Vec<_> = self.query.candidates().collect();
                self.ask(rays, i, |refiner, case| refiner.occluded(case, met, light, &candidates))
            }
        }
    }

    /// Takes everything about place `i` from wide arithmetic.
    #[inline(never)]
    pub(super) fn refine(&mut self, rays: &Rays, interactions: &mut SurfaceInteractions, i: usize) {
        let Some(met) = Decision::of(interactions.met[i]) else { return };
        let tracer = self.tracer;
        if tracer.refinement == Refinement::Off {
            interactions.set(i, &interactions.one(i).taken_as_it_is());
            return;
        }
        let goes_on =
            interactions.reflect[i] * rays.throughput[i] > 0.0 && self.step + 1 < tracer.settings.max_depth as usize;
        let throughput = rays.throughput[i];
        let found = self.ask(rays, i, |refiner, case| refiner.interaction(case, met, throughput, goes_on));
        let Some(refined) = found else { return };
        interactions.set(i, &refined.interaction);
        let material = tracer.material(met.id);
        if let (Pigment::Texture(picture), Some(hit)) = (material.pigment, &refined.hit) {
            let color = material.albedo * tracer.picture_color(picture, hit.uv, met.id);
            for (to, x) in interactions.albedo.iter_mut().zip(color.to_array()) {
                to[i] = x;
            }
        }
        self.refined_interactions.push(refined);
        interactions.refined[i] = self.refined_interactions.len() as u32;
    }
}
