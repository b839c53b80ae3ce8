//! What a wave keeps of each path, and its way to wide arithmetic.

use crate::geometry::{ObjectId, V3};
use crate::scene::Pigment;
use crate::trace::arbiter::Decision;
use crate::trace::camera::PlanePoint;
use crate::trace::court::{Case, Court, Refined};
use crate::trace::packet::{INSIDE, NONE};
use crate::trace::query::{Closest, Occluded, Scratch};
use crate::trace::record::Recording;
use crate::trace::shade;
use crate::trace::{Refinement, Sample, Tracer};

use super::lanes::{Places, Rays};

/// The paths of one wave.
pub(super) struct Paths<'a, 'r> {
    pub(super) tracer: &'a Tracer,
    pub(super) points: &'a [PlanePoint],
    pub(super) out: &'a mut [Sample],
    /// Rays of each path so far.
    pub(super) mirrors: &'a mut [u32],
    pub(super) shadows: &'a mut [u32],
    /// Per step, what each path met.
    pub(super) trails: &'a mut Vec<Vec<u32>>,
    pub(super) query: &'a mut Scratch,
    /// Wide arithmetic of the paths that needed it; empty until one does.
    pub(super) courts: Vec<Option<Box<Court>>>,
    /// Places of this step that f64 alone would misplace.
    pub(super) refined_places: Vec<Refined>,
    pub(super) refined: u64,
    /// Mirrors behind the rays of this step.
    pub(super) step: usize,
    /// Where paths are recorded, if they are.
    pub(super) record: Option<Recording<'r>>,
}

impl Paths<'_, '_> {
    /// Puts a question about `path` to its court, with what that path met before this step.
    fn ask<A>(&mut self, path: usize, question: impl FnOnce(&mut Court, &Case<'_>) -> A) -> A {
        self.refined += 1;
        if self.courts.is_empty() {
            self.courts.resize_with(self.points.len(), || None);
        }
        let trail: Vec<_> = self.trails[..self.step].iter().filter_map(|met| decision(met[path])).collect();
        let case = Case { tracer: self.tracer, point: self.points[path], trail: &trail };
        question(self.courts[path].get_or_insert_default(), &case)
    }

    /// Of which paths something stayed open in the widest numbers; empty where none was asked about.
    pub(super) fn unresolved(&self) -> Vec<bool> {
        self.courts.iter().map(|c| c.as_ref().is_some_and(|c| c.unresolved())).collect()
    }

    /// Decides what ray `i` meets: in f64 among `candidates`, or all objects, and if need be beyond.
    #[inline(never)]
    pub(super) fn settle(
        &mut self,
        rays: &Rays,
        i: usize,
        candidates: Option<impl Iterator<Item = u32>>,
        places: &mut Places,
    ) {
        let prepared = &self.tracer.prepared;
        let (ray, from) = (rays.one(i), decision(rays.own[i]));
        let found = match candidates {
            Some(ids) => prepared.closest_among(&ray, from, ids.map(|id| ObjectId(id & !INSIDE)), self.query),
            None => prepared.closest(&ray, from, self.query),
        };
        places.met[i] = match found {
            Closest::Nothing => NONE,
            Closest::Sure(d) => code(d),
            Closest::Doubt if self.tracer.refinement == Refinement::Off => {
                self.query.likely_closest().map_or(NONE, code)
            }
            Closest::Doubt => {
                let candidates: Vec<_> = self.query.candidates().collect();
                let found = self.ask(rays.path[i] as usize, |court, case| court.closest(case, &candidates));
                found.map_or(NONE, code)
            }
        };
    }

    /// Decides whether place `i` is in the shadow of `light`, as [`Self::settle`] does.
    #[inline(never)]
    pub(super) fn settle_shadow(
        &mut self,
        rays: &Rays,
        places: &Places,
        i: usize,
        light: usize,
        candidates: Option<impl Iterator<Item = u32>>,
    ) -> bool {
        let prepared = &self.tracer.prepared;
        let place = places.one(i);
        let to = V3::splat(prepared.local.lights[light]);
        let ray = shade::towards(&place, to, to - place.p);
        let met = decision(places.met[i]);
        let occluded = match candidates {
            Some(ids) => prepared.occluded_among(&ray, met, ids.map(|id| ObjectId(id & !INSIDE)), self.query),
            None => prepared.occluded(&ray, met, self.query),
        };
        match (occluded, met) {
            (Occluded::No, _) | (_, None) => false,
            (Occluded::Yes, _) => true,
            (Occluded::Doubt, _) if self.tracer.refinement == Refinement::Off => self.query.likely_occluded(),
            (Occluded::Doubt, Some(met)) => {
                let candidates: Vec<_> = self.query.candidates().collect();
                let light = prepared.scene.lights()[light];
                self.ask(rays.path[i] as usize, |court, case| court.occluded(case, met, light, &candidates))
            }
        }
    }

    /// Takes everything about place `i` from wide arithmetic.
    #[inline(never)]
    pub(super) fn refine(&mut self, rays: &Rays, places: &mut Places, i: usize) {
        let Some(met) = decision(places.met[i]) else { return };
        let tracer = self.tracer;
        if tracer.refinement == Refinement::Off {
            places.set(i, &places.one(i).taken_as_it_is());
            return;
        }
        let goes_on =
            places.reflect[i] * rays.throughput[i] > 0.0 && self.step + 1 < tracer.settings.max_depth as usize;
        let throughput = rays.throughput[i];
        let found = self.ask(rays.path[i] as usize, |court, case| court.place(case, met, throughput, goes_on));
        let Some(refined) = found else { return };
        places.set(i, &refined.place);
        let material = tracer.material(met.id);
        if let (Pigment::Picture(picture), Some(hit)) = (material.pigment, &refined.hit) {
            let uv = hit.coordinates(tracer);
            let color = material.albedo * tracer.picture_color(picture, uv, met.id);
            for (to, x) in places.albedo.iter_mut().zip(color.to_array()) {
                to[i] = x;
            }
        }
        self.refined_places.push(refined);
        places.refined[i] = self.refined_places.len() as u32;
    }
}

/// An object's code as a decision.
pub(super) fn decision(code: u32) -> Option<Decision> {
    (code != NONE).then_some(Decision { id: ObjectId(code & !INSIDE), inside: code & INSIDE != 0 })
}

fn code(d: Decision) -> u32 {
    d.id.0 | if d.inside { INSIDE } else { 0 }
}
