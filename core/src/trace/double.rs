//! A path followed to twice the digits of f64, for values alone.
//!
//! Small curved mirrors far from one another magnify errors by thousands each, so that after a
//! few of them f64 has no digits left while decisions are still clear. The formulas of
//! `trace::shade` then give the same place in double-double, at a fraction of what the court
//! takes; what they cannot bound tightly enough goes there.

use glam::DVec3;

use super::arbiter::Decision;
use super::court::Case;
use super::shade::{self, Place};
use crate::geometry::local::DoubleObject;
use crate::geometry::{DoubleDouble, Ray, Real, U};

/// Longer paths are left to the court, which remembers how far it has followed them.
const SHORT: usize = 8;

/// A path as far as it was followed.
pub(super) struct DoublePath {
    /// Decisions followed, the last of them, and the ray after it.
    done: usize,
    from: Option<Decision>,
    ray: Ray<DoubleDouble>,
    /// What that ray is known to meet, and where.
    met: Option<(Decision, Place<DoubleDouble>)>,
}

impl DoublePath {
    pub(super) fn new(case: &Case<'_>) -> Self {
        Self { done: 0, from: None, ray: case.tracer.frame.double_ray(case.point), met: None }
    }

    /// Where the path of `case`, which is this one, meets `met`, right to the last digits of f64, and the
    /// direction mirrored there.
    pub(super) fn place(&mut self, case: &Case<'_>, met: Decision) -> Option<(Place, DVec3)> {
        if case.trail.len() > SHORT {
            return None;
        }
        while let Some(&decision) = case.trail.get(self.done) {
            let place = self.meet(case, decision)?;
            self.ray = shade::reflect(&self.ray, &place);
            self.from = Some(decision);
            self.met = None;
            self.done += 1;
        }
        let place = self.meet(case, met)?;
        let mirrored = shade::reflect(&self.ray, &place);
        let p = place.p.to_f64();
        // Rounding to f64 loses half a unit of each coordinate; what was lost before must be no more.
        let known = place.ep.hi <= U * p.norm1() && place.en.hi <= U && mirrored.ed.hi <= U;
        known.then(|| {
            let place = Place { p, ep: 4.0 * U * p.norm1(), n: place.n.to_f64(), en: 4.0 * U };
            (place, mirrored.d.to_f64().to_dvec3())
        })
    }

    fn meet(&mut self, case: &Case<'_>, decision: Decision) -> Option<Place<DoubleDouble>> {
        if let Some((of, place)) = self.met
            && of == decision
        {
            return Some(place);
        }
        let place = meet(case, &self.ray, decision, self.from)?;
        self.met = Some((decision, place));
        Some(place)
    }
}

fn meet(
    case: &Case<'_>,
    ray: &Ray<DoubleDouble>,
    decision: Decision,
    from: Option<Decision>,
) -> Option<Place<DoubleDouble>> {
    let prepared = &case.tracer.prepared;
    let flag = |b: bool| DoubleDouble::splat(if b { 1.0 } else { 0.0 });
    Some(match prepared.local.double(&prepared.scene, decision.id)? {
        DoubleObject::Plane(plane) => shade::on_plane(ray, &plane),
        DoubleObject::Triangle(triangle) => shade::on_triangle(ray, &triangle),
        DoubleObject::Sphere(sphere) => {
            let own = from.is_some_and(|f| f.id == decision.id);
            shade::on_sphere(ray, &sphere, flag(decision.inside), flag(own))
        }
    })
}
