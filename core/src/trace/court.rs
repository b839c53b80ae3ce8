//! One path before the arbiter: followed in wide arithmetic only as far as it was asked about.

use glam::DVec3;

use super::Tracer;
use super::arbiter::{self, Decision, ExactHit, ExactRay, FIRST, LAST, Unsure};
use super::camera::PlanePoint;
use super::double;
use super::shade::Place;
use crate::geometry::{ObjectId, U, V3};
use crate::scene::Pigment;

/// The path in numbers of one width.
struct ExactPath<const N: usize> {
    /// Decisions followed, and the ray after them.
    done: usize,
    ray: ExactRay<N>,
    /// The digits are used up: nothing more can be told.
    lost: bool,
}

impl<const N: usize> ExactPath<N> {
    fn new(tracer: &Tracer, point: PlanePoint) -> Self {
        Self { done: 0, ray: tracer.frame.exact_ray(point), lost: false }
    }

    /// The ray after all decisions of the trail.
    fn ray(&mut self, case: &Case<'_>) -> Result<ExactRay<N>, Unsure> {
        while !self.lost && self.done < case.trail.len() {
            match arbiter::hit(&case.tracer.prepared.scene, &self.ray, case.trail[self.done]) {
                Ok(hit) => self.ray = hit.reflect(&self.ray.d),
                Err(Unsure) => self.lost = true,
            }
            self.done += 1;
        }
        if self.lost { Err(Unsure) } else { Ok(self.ray) }
    }
}

/// What is asked about: a path, by its decisions so far, which only ever grow.
#[derive(Clone, Copy)]
pub(crate) struct Case<'a> {
    pub(crate) tracer: &'a Tracer,
    pub(crate) point: PlanePoint,
    pub(crate) trail: &'a [Decision],
}

/// A question about a path, put at one width.
trait Question {
    type Answer;
    fn ask<const N: usize>(&self, case: &Case<'_>, ray: &ExactRay<N>) -> Result<Self::Answer, Unsure>;
}

/// Which of some objects the path meets next.
struct Closest<'a>(&'a [ObjectId]);

impl Question for Closest<'_> {
    type Answer = Option<Decision>;
    fn ask<const N: usize>(&self, case: &Case<'_>, ray: &ExactRay<N>) -> Result<Option<Decision>, Unsure> {
        let found = arbiter::closest(&case.tracer.prepared.scene, ray, self.0.iter().copied())?;
        Ok(found.map(|(decision, _)| decision))
    }
}

/// Whether one of some objects stands between the point met and a light.
struct Occluded<'a> {
    met: Decision,
    light: DVec3,
    candidates: &'a [ObjectId],
}

impl Question for Occluded<'_> {
    type Answer = bool;
    fn ask<const N: usize>(&self, case: &Case<'_>, ray: &ExactRay<N>) -> Result<bool, Unsure> {
        let scene = &case.tracer.prepared.scene;
        let segment = arbiter::hit(scene, ray, self.met)?.towards(self.light);
        arbiter::occluded(scene, &segment, self.candidates.iter().copied())
    }
}

/// The point met, and the direction mirrored there if that is `mirrored` on.
struct Hit {
    met: Decision,
    mirrored: bool,
}

impl Question for Hit {
    type Answer = (ExactHit<LAST>, DVec3);
    fn ask<const N: usize>(&self, case: &Case<'_>, ray: &ExactRay<N>) -> Result<Self::Answer, Unsure> {
        let hit = arbiter::hit(&case.tracer.prepared.scene, ray, self.met)?;
        if !hit.is_known() {
            return Err(Unsure);
        }
        let d = if self.mirrored { hit.reflect(&ray.d).d.to_f64() } else { DVec3::ZERO };
        Ok((hit.resize(), d))
    }
}

/// A place that f64 alone would misplace.
pub(crate) struct Refined {
    pub(crate) place: Place,
    /// The direction mirrored there, where it was asked for; rounded.
    pub(crate) mirrored: DVec3,
    /// The place itself, where its rounding would be too much for what is computed from it.
    pub(crate) hit: Option<Box<ExactHit<LAST>>>,
}

/// The path at both widths, each as far as it was needed.
#[derive(Default)]
pub(crate) struct Court {
    first: Option<ExactPath<FIRST>>,
    last: Option<Box<ExactPath<LAST>>>,
    /// The path that the last width gives if its numbers are taken as they are.
    given: Option<Box<ExactPath<LAST>>>,
}

impl Court {
    /// Whether something was asked that even the last width could not tell.
    pub(crate) fn unresolved(&self) -> bool {
        self.given.is_some()
    }

    fn ask<Q: Question>(&mut self, case: &Case<'_>, question: &Q) -> Option<Q::Answer> {
        let Case { tracer, point, .. } = *case;
        let first = self.first.get_or_insert_with(|| ExactPath::new(tracer, point));
        if let Ok(answer) = first.ray(case).and_then(|ray| question.ask(case, &ray)) {
            return Some(answer);
        }
        let last = self.last.get_or_insert_with(|| Box::new(ExactPath::new(tracer, point)));
        if let Ok(answer) = last.ray(case).and_then(|ray| question.ask(case, &ray)) {
            return Some(answer);
        }
        let given = self.given.get_or_insert_with(|| {
            let path = ExactPath::new(tracer, point);
            Box::new(ExactPath { ray: path.ray.taken_as_it_is(), ..path })
        });
        given.ray(case).and_then(|ray| question.ask(case, &ray)).ok()
    }

    /// Which of `candidates` the path meets next.
    pub(crate) fn closest(&mut self, case: &Case<'_>, candidates: &[ObjectId]) -> Option<Decision> {
        self.ask(case, &Closest(candidates)).flatten()
    }

    /// Whether one of `candidates` stands between the point met and `light`.
    pub(crate) fn occluded(&mut self, case: &Case<'_>, met: Decision, light: DVec3, candidates: &[ObjectId]) -> bool {
        self.ask(case, &Occluded { met, light, candidates }).unwrap_or(false)
    }

    /// The place met, as right as f64 can say it, and, where it is asked for, the direction mirrored
    /// there. `throughput` is what the path has left of the light.
    pub(crate) fn place(&mut self, case: &Case<'_>, met: Decision, throughput: f64, mirrored: bool) -> Option<Refined> {
        let tracer = case.tracer;
        let pictured = matches!(tracer.material(met.id).pigment, Pigment::Picture(_));
        if !pictured
            && let Some((place, mirrored)) = double::place(case, met)
            && !tracer.too_wide(&place, throughput)
        {
            return Some(Refined { place, mirrored, hit: None });
        }
        let (hit, mirrored) = self.ask(case, &Hit { met, mirrored })?;
        let p = V3::splat(arbiter::to_local(&tracer.prepared.local, &tracer.prepared.scene, &hit.p));
        let place = Place { p, ep: 2.0 * U * p.norm1(), n: V3::splat(hit.normal()), en: 2.0 * U };
        Some(Refined { place, mirrored, hit: Some(Box::new(hit)) })
    }
}
