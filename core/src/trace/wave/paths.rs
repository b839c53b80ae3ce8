//! What a wave keeps of each path, and its way to wide arithmetic.

use glam::DVec3;

use crate::geometry::{ObjectId, U, V3};
use crate::scene::Pigment;
use crate::trace::arbiter::{self, Decision, ExactHit, LAST};
use crate::trace::camera::PlanePoint;
use crate::trace::court::Court;
use crate::trace::packet::{INSIDE, NONE};
use crate::trace::query::{Closest, Occluded, Scratch};
use crate::trace::record::Recording;
use crate::trace::shade::{self, Place};
use crate::trace::{Sample, Tracer, texture};

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
    pub(super) courts: Vec<Option<Box<Court<'a>>>>,
    /// Points met at this step that f64 does not place well enough, and directions mirrored there.
    pub(super) hits: Vec<(ExactHit<LAST>, DVec3)>,
    pub(super) refined: u64,
    /// Mirrors behind the rays of this step.
    pub(super) step: usize,
    /// Where paths are recorded, if they are.
    pub(super) record: Option<Recording<'r>>,
}

impl<'a> Paths<'a, '_> {
    /// The court of `path`, and what that path met before this step.
    fn court(&mut self, path: usize) -> (&mut Court<'a>, Vec<Decision>) {
        self.refined += 1;
        if self.courts.is_empty() {
            self.courts.resize_with(self.points.len(), || None);
        }
        let trail = self.trails[..self.step].iter().filter_map(|met| decision(met[path])).collect();
        let (tracer, point) = (self.tracer, self.points[path]);
        (self.courts[path].get_or_insert_with(|| Box::new(Court::new(tracer, point))), trail)
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
            Closest::Doubt => {
                let candidates: Vec<_> = self.query.candidates().collect();
                let (court, trail) = self.court(rays.path[i] as usize);
                court.closest(&trail, &candidates).map_or(NONE, code)
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
            (Occluded::Doubt, Some(met)) => {
                let candidates: Vec<_> = self.query.candidates().collect();
                let light = prepared.scene.lights()[light];
                let (court, trail) = self.court(rays.path[i] as usize);
                court.occluded(&trail, met, light, &candidates)
            }
        }
    }

    /// Takes everything about place `i` from wide arithmetic.
    #[inline(never)]
    pub(super) fn refine(&mut self, rays: &Rays, places: &mut Places, i: usize) {
        let Some(met) = decision(places.met[i]) else { return };
        let tracer = self.tracer;
        let scene = &tracer.prepared.scene;
        let (court, trail) = self.court(rays.path[i] as usize);
        let Some((hit, mirrored)) = court.hit(&trail, met) else { return };
        let p = V3::splat(arbiter::to_local(&tracer.prepared.local, scene, &hit.p));
        places.set(i, &Place { p, ep: 2.0 * U * p.norm1(), n: V3::splat(hit.normal()), en: 2.0 * U });
        let material = tracer.material(met.id);
        if let Pigment::Picture(picture) = material.pigment {
            let uv = texture::exact_coordinates(scene, &tracer.mappings, &hit);
            let color = material.albedo * tracer.picture_color(picture, uv, met.id);
            for (to, x) in places.albedo.iter_mut().zip(color.to_array()) {
                to[i] = x;
            }
        }
        self.hits.push((hit, mirrored));
        places.exact[i] = self.hits.len() as u32;
    }
}

/// An object's code as a decision.
pub(super) fn decision(code: u32) -> Option<Decision> {
    (code != NONE).then_some(Decision { id: ObjectId(code & !INSIDE), inside: code & INSIDE != 0 })
}

fn code(d: Decision) -> u32 {
    d.id.0 | if d.inside { INSIDE } else { 0 }
}
