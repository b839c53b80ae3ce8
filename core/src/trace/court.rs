//! One path before the arbiter: followed in wide arithmetic only as far as it was asked about.

use glam::DVec3;

use super::Tracer;
use super::arbiter::{self, Decision, ExactHit, ExactRay, FIRST, LAST, Unsure};
use super::camera::PlanePoint;
use crate::geometry::ObjectId;

/// The path in numbers of one width.
struct ExactPath<'a, const N: usize> {
    tracer: &'a Tracer,
    point: PlanePoint,
    /// Decisions followed, and the ray after them.
    at: Option<(usize, ExactRay<N>)>,
}

impl<const N: usize> ExactPath<'_, N> {
    /// The ray after all decisions of `trail`.
    fn ray(&mut self, trail: &[Decision]) -> Result<ExactRay<N>, Unsure> {
        let (mut done, mut ray) = self.at.unwrap_or_else(|| (0, self.tracer.frame.exact_ray(self.point)));
        let scene = &self.tracer.prepared.scene;
        for &decision in &trail[done..] {
            ray = arbiter::hit(scene, &ray, decision)?.reflect(&ray.d);
            done += 1;
        }
        self.at = Some((done, ray));
        Ok(ray)
    }

    /// The point met by the ray after all decisions of `trail`.
    fn hit(&mut self, trail: &[Decision], decision: Decision) -> Result<ExactHit<N>, Unsure> {
        let ray = self.ray(trail)?;
        arbiter::hit(&self.tracer.prepared.scene, &ray, decision)
    }

    fn closest(&mut self, trail: &[Decision], candidates: &[ObjectId]) -> Result<Option<Decision>, Unsure> {
        let found = arbiter::closest(&self.tracer.prepared.scene, &self.ray(trail)?, candidates.iter().copied())?;
        Ok(found.map(|(decision, _)| decision))
    }

    fn occluded(
        &mut self,
        trail: &[Decision],
        met: Decision,
        light: DVec3,
        candidates: &[ObjectId],
    ) -> Result<bool, Unsure> {
        let segment = self.hit(trail, met)?.towards(light);
        arbiter::occluded(&self.tracer.prepared.scene, &segment, candidates.iter().copied())
    }
}

/// Mirrors that a path in the first width may have behind it: each can cost it several bits.
const SHORT: usize = 8;

/// Coordinates of 2^FAR and more lose too much of their fraction to the first width.
const FAR: i64 = 128;

/// The path at both widths. Each question gives the decisions so far, which only ever grow.
pub(crate) struct Court<'a> {
    first: ExactPath<'a, FIRST>,
    last: ExactPath<'a, LAST>,
}

impl<'a> Court<'a> {
    pub(crate) fn new(tracer: &'a Tracer, point: PlanePoint) -> Self {
        Self { first: ExactPath { tracer, point, at: None }, last: ExactPath { tracer, point, at: None } }
    }

    /// Which of `candidates` the path meets next.
    pub(crate) fn closest(&mut self, trail: &[Decision], candidates: &[ObjectId]) -> Option<Decision> {
        if trail.len() <= SHORT
            && let Ok(found) = self.first.closest(trail, candidates)
        {
            return found;
        }
        self.last.closest(trail, candidates).ok().flatten()
    }

    /// Whether one of `candidates` stands between the point met and `light`.
    pub(crate) fn occluded(
        &mut self,
        trail: &[Decision],
        met: Decision,
        light: DVec3,
        candidates: &[ObjectId],
    ) -> bool {
        if trail.len() <= SHORT
            && let Ok(occluded) = self.first.occluded(trail, met, light, candidates)
        {
            return occluded;
        }
        self.last.occluded(trail, met, light, candidates).unwrap_or(false)
    }

    /// The point met and the direction mirrored there. The widest numbers are never unsure.
    pub(crate) fn hit(&mut self, trail: &[Decision], met: Decision) -> Option<(ExactHit<LAST>, DVec3)> {
        if trail.len() <= SHORT
            && let Ok(hit) = self.first.hit(trail, met)
            && let Ok(ray) = self.first.ray(trail)
            // A picture's place on a plane is what is left of a coordinate modulo 1.
            && hit.p.exponent() < FAR
        {
            return Some((hit.resize(), hit.reflect(&ray.d).d.to_f64()));
        }
        let hit = self.last.hit(trail, met).ok()?;
        let ray = self.last.ray(trail).ok()?;
        Some((hit, hit.reflect(&ray.d).d.to_f64()))
    }
}
