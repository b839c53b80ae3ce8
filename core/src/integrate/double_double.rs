//! A path followed to twice the digits of f64.
//!
//! Most of what f64 leaves open is clear in double-double, by the same tests. Small curved mirrors far from one another
//! magnify errors by thousands each, so that after a few of them f64 has no digits left while decisions are still
//! clear. The formulas of `integrate::shade` then give the same place in double-double, at a fraction of what the
//! refiner takes, and what is met from there is asked in f64 first, now that the ray is known so well. What cannot be
//! bound tightly enough goes to the refiner.

use super::refine::{Case, Refined, Start};
use super::shade;
use crate::numeric::{DoubleDouble, Real, U, V3};
use crate::shapes::{Decision, ObjectId, Ray, Span, SurfaceInteraction, interaction_double, test_double};
use crate::traverse::{Closest, Occluded, PreparedScene, Scratch};

/// Longer paths are left to the refiner: few of them have digits left.
const SHORT: usize = 64;

/// A path as far as it was followed.
pub(super) struct DoubleDoublePath {
    /// Decisions followed, the last of them, and the ray after it.
    done: usize,
    from: Option<Decision>,
    ray: Ray<DoubleDouble>,
    /// What that ray is known to meet, and where.
    met: Option<(Decision, SurfaceInteraction<DoubleDouble>)>,
    query: Scratch,
}

/// A bound, rounded upwards.
fn bound(e: DoubleDouble) -> f64 {
    e.hi * (1.0 + 1e-9)
}

/// The ray in f64, which tells most candidates apart once it is known that well.
fn rounded(ray: &Ray<DoubleDouble>) -> Ray {
    let o = ray.o.to_f64();
    Ray::new(o, ray.d.to_f64(), bound(ray.eo) + 2.0 * U * o.norm1(), bound(ray.ed) + 2.0 * U)
}

impl DoubleDoublePath {
    pub(super) fn new(case: &Case<'_>) -> Self {
        let (from, ray) = match case.start {
            Start::Camera(point) => (None, case.tracer.frame.double_ray(point)),
            Start::Given(ray, from) => {
                let zero = DoubleDouble::splat(0.0);
                (from, Ray::new(V3::splat(ray.o.to_dvec3()), V3::splat(ray.d.to_dvec3()), zero, zero))
            }
        };
        Self { done: 0, from, ray, met: None, query: Scratch::default() }
    }

    /// Where the path of `case`, which is this one, meets `met`, and the direction mirrored there: rounded, their
    /// bounds those of this path and of rounding.
    pub(super) fn interaction(&mut self, case: &Case<'_>, met: Decision) -> Option<Refined> {
        self.follow(case)?;
        let interaction = self.intersect(case, met)?;
        let mirrored = shade::reflect(&self.ray, &interaction);
        let p = interaction.p.to_f64();
        let rounded = SurfaceInteraction {
            p,
            ep: bound(interaction.ep) + 2.0 * U * p.norm1(),
            n: interaction.n.to_f64(),
            en: bound(interaction.en) + 2.0 * U,
        };
        let turn = bound(mirrored.ed) + 2.0 * U;
        Some(Refined { interaction: rounded, mirrored: mirrored.d.to_f64().to_dvec3(), turn, hit: None })
    }

    /// Follows the trail to its end.
    fn follow(&mut self, case: &Case<'_>) -> Option<()> {
        if case.trail.len() > SHORT {
            return None;
        }
        while let Some(&decision) = case.trail.get(self.done) {
            let interaction = self.intersect(case, decision)?;
            self.ray = shade::reflect(&self.ray, &interaction);
            self.from = Some(decision);
            self.met = None;
            self.done += 1;
        }
        Some(())
    }

    /// Which of `candidates` the path surely meets next, or that it meets none; `None` where that is not sure.
    pub(super) fn closest(&mut self, case: &Case<'_>, candidates: &[ObjectId]) -> Option<Option<Decision>> {
        self.follow(case)?;
        let (prepared, query) = (&case.tracer.prepared, &mut self.query);
        match prepared.closest_among(&rounded(&self.ray), self.from, candidates.iter().copied(), query) {
            Closest::Nothing => return Some(None),
            Closest::Sure(decision) => return Some(Some(decision)),
            Closest::Doubt => {}
        }
        let mut found = Vec::new();
        for id in query.candidates() {
            if let Some(span) = test(case, &self.ray, id, self.from)? {
                found.push((id, span));
            }
        }
        let bound = found.iter().filter(|(_, s)| s.sure).map(|(_, s)| s.hi).reduce(Real::min);
        if let Some(bound) = bound {
            found.retain(|(_, s)| !(s.lo > bound));
        }
        prepared.drop_covered(&mut found);
        match found[..] {
            [] => Some(None),
            [(id, Span { sure: true, inside, .. })] => Some(Some(Decision { id, inside })),
            _ => None,
        }
    }

    /// Whether one of `candidates` surely stands between the point of `met` and the `light`-th light, or none
    /// does; `None` where that is not sure.
    pub(super) fn occluded(
        &mut self,
        case: &Case<'_>,
        met: Decision,
        light: usize,
        candidates: &[ObjectId],
    ) -> Option<bool> {
        self.follow(case)?;
        let interaction = self.intersect(case, met)?;
        let prepared = &case.tracer.prepared;
        let place = prepared.local.double_light(&prepared.scene, light)?;
        let ray = shade::towards(&interaction, place, place - interaction.p);
        let (ids, query) = (candidates.iter().copied(), &mut self.query);
        match prepared.occluded_among(&rounded(&ray), Some(met), Some(light), ids, query) {
            Occluded::No => return Some(false),
            Occluded::Yes => return Some(true),
            Occluded::Doubt => {}
        }
        let one = DoubleDouble::splat(1.0);
        let mut open = false;
        for id in query.candidates() {
            match test(case, &ray, id, Some(met))? {
                Some(span) if span.sure && span.hi < one => return Some(true),
                Some(span) => open |= !(span.lo > one),
                None => {}
            }
        }
        (!open).then_some(false)
    }

    fn intersect(&mut self, case: &Case<'_>, decision: Decision) -> Option<SurfaceInteraction<DoubleDouble>> {
        if let Some((of, interaction)) = self.met
            && of == decision
        {
            return Some(interaction);
        }
        let prepared = &case.tracer.prepared;
        let PreparedScene { scene, local, .. } = &**prepared;
        let interaction = interaction_double(scene, local, &self.ray, decision, self.from)?;
        self.met = Some((decision, interaction));
        Some(interaction)
    }
}

/// Where `ray`, which starts on `from`, may meet object `id`; `None` where its numbers are too large.
fn test(
    case: &Case<'_>,
    ray: &Ray<DoubleDouble>,
    id: ObjectId,
    from: Option<Decision>,
) -> Option<Option<Span<DoubleDouble>>> {
    let PreparedScene { scene, local, .. } = &*case.tracer.prepared;
    test_double(scene, local, ray, id, from.filter(|f| f.id == id))
}
