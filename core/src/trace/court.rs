//! One path before the arbiter: followed in wide arithmetic only as far as it was asked about.

use glam::DVec3;

use super::Tracer;
use super::arbiter::{self, Decision, ExactHit, ExactRay, FIRST, LAST};
use super::camera::PlanePoint;
use crate::geometry::ObjectId;
use crate::scene::Scene;

/// The path in numbers of one width.
struct ExactPath<'a, const N: usize> {
    tracer: &'a Tracer,
    point: PlanePoint,
    /// Decisions followed, and the ray after them.
    at: Option<(usize, ExactRay<N>)>,
}

impl<const N: usize> ExactPath<'_, N> {
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
    pub(crate) fn closest(&mut self, scene: &Scene, trail: &[Decision], candidates: &[ObjectId]) -> Option<Decision> {
        let candidates = candidates.iter().copied();
        if trail.len() <= SHORT
            && let Ok(found) = arbiter::closest(scene, &self.first.ray(trail), candidates.clone())
        {
            return found.map(|(d, _)| d);
        }
        arbiter::closest(scene, &self.last.ray(trail), candidates).ok().flatten().map(|(d, _)| d)
    }

    /// Whether one of `candidates` stands between the point met and `light`.
    pub(crate) fn occluded(
        &mut self,
        scene: &Scene,
        trail: &[Decision],
        met: Decision,
        light: DVec3,
        candidates: &[ObjectId],
    ) -> bool {
        let candidates = candidates.iter().copied();
        if trail.len() <= SHORT {
            let segment = self.first.hit(trail, met).towards(light);
            if let Ok(occluded) = arbiter::occluded(scene, &segment, candidates.clone()) {
                return occluded;
            }
        }
        let segment = self.last.hit(trail, met).towards(light);
        arbiter::occluded(scene, &segment, candidates).unwrap_or(false)
    }

    /// The point met.
    pub(crate) fn hit(&mut self, trail: &[Decision], met: Decision) -> ExactHit<LAST> {
        if trail.len() <= SHORT { self.first.hit(trail, met).resize() } else { self.last.hit(trail, met) }
    }

    /// The direction mirrored at `hit`, met after `trail`.
    pub(crate) fn mirrored(&mut self, trail: &[Decision], hit: &ExactHit<LAST>) -> DVec3 {
        if trail.len() <= SHORT {
            hit.resize::<FIRST>().reflect(&self.first.ray(trail).d).d.to_f64()
        } else {
            hit.reflect(&self.last.ray(trail).d).d.to_f64()
        }
    }
}
