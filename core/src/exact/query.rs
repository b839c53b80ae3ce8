//! Single questions about a prepared scene, answered exactly.

use glam::DVec3;

use super::{closest_hit, proof};
use crate::numeric::{TINY, U, V3, Vector};
use crate::shapes::exact::FIRST;
use crate::shapes::{Ray, surface_and_order};
use crate::traverse::{Closest, Occluded, PreparedScene, Scratch};

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// The object's place in the document.
    pub order: u32,
    /// Distance in units of the direction's length, the nearest f64 to the real number.
    pub t: f64,
}

impl PreparedScene {
    /// The nearest object that the ray from `origin` along `direction` (world space, any
    /// length but zero) meets at a distance above 0, exactly: real arithmetic on these numbers.
    /// Equal distances go to the object that comes first in the document.
    #[must_use]
    pub fn closest_hit(&self, origin: DVec3, direction: DVec3) -> Option<RayHit> {
        let d = Vector::<FIRST>::new(direction);
        let d = d.scale(-d.exponent()).to_f64();
        let o = self.local.point(origin);
        // Not exactly at the eye, even where it is rounded to there.
        let eo = 2.0 * U * o.abs().element_sum() + TINY;
        let ray = Ray::new(V3::splat(o), V3::splat(d), eo, 4.0 * U);
        let mut scratch = Scratch::default();
        let candidates: Vec<_> = match self.closest(&ray, None, &mut scratch) {
            Closest::Nothing => return None,
            Closest::Sure(decision) => vec![decision.id],
            Closest::Doubt => scratch.candidates().collect(),
        };
        let (id, t) = closest_hit(&self.scene, origin, direction, &candidates)??;
        Some(RayHit { order: surface_and_order(&self.scene, id).1, t })
    }

    /// Whether an object meets the open segment between two points of world space, exactly.
    #[must_use]
    pub fn is_occluded(&self, from: DVec3, to: DVec3) -> bool {
        let (a, b) = (self.local.point(from), self.local.point(to));
        let d = b - a;
        let e = 2.0 * U * (a.abs().element_sum() + b.abs().element_sum());
        let len = d.length();
        let ray = Ray::new(V3::splat(a), V3::splat(d), 2.0 * e, 4.0 * U + e / len);
        let mut scratch = Scratch::default();
        match self.occluded(&ray, None, None, &mut scratch) {
            Occluded::No => false,
            Occluded::Yes => true,
            Occluded::Doubt => {
                let candidates: Vec<_> = scratch.candidates().collect();
                proof::is_between(&self.scene, [from, to], &candidates).unwrap_or(false)
            }
        }
    }
}
