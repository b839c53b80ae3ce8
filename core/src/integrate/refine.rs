//! One path in exact arithmetic: followed in wide arithmetic only as far as it was asked about.

use glam::{DVec2, DVec3};

use super::Tracer;
use super::double_double::DoubleDoublePath;
use super::shade;
use crate::exact::{self, CameraPath, Point, Proof};
use crate::film::PlanePoint;
use crate::numeric::{U, Unsure, V3, Vector};
use crate::shapes::exact::{ExactHit, ExactRay, FIRST, LAST, hit};
use crate::shapes::{Decision, ObjectId, Ray, SurfaceInteraction, sphere, texture};
use crate::traverse::PreparedScene;

/// The path in numbers of one width.
struct ExactPath<const N: usize> {
    /// Decisions followed, and the ray after them.
    done: usize,
    ray: ExactRay<N>,
    /// What that ray is known to meet, and where.
    hit: Option<(Decision, ExactHit<N>)>,
    /// The digits are used up: nothing more can be told.
    lost: bool,
}

impl<const N: usize> ExactPath<N> {
    fn new(done: usize, ray: ExactRay<N>) -> Self {
        Self { done, ray, hit: None, lost: false }
    }

    /// The ray after all decisions of the trail.
    fn ray(&mut self, case: &Case<'_>) -> Result<&ExactRay<N>, Unsure> {
        while !self.lost && self.done < case.trail.len() {
            if case.tracer.is_unwanted() {
                return Err(Unsure);
            }
            match Self::met(&mut self.hit, &self.ray, case, case.trail[self.done]) {
                Ok(hit) => {
                    self.ray = hit.reflect(&self.ray.d);
                    self.hit = None;
                    self.done += 1;
                }
                Err(Unsure) => self.lost = true,
            }
        }
        if self.lost { Err(Unsure) } else { Ok(&self.ray) }
    }

    /// Where `ray`, which was reached, meets `decision`: asked for each light, and by the next step.
    fn met<'a>(
        known: &'a mut Option<(Decision, ExactHit<N>)>,
        ray: &ExactRay<N>,
        case: &Case<'_>,
        decision: Decision,
    ) -> Result<&'a ExactHit<N>, Unsure> {
        if known.is_none_or(|(of, _)| of != decision) {
            *known = None;
        }
        let prepared = &case.tracer.prepared;
        Ok(match known {
            Some((_, hit)) => hit,
            none => &none.insert((decision, hit(&prepared.scene, &prepared.local, ray, decision)?)).1,
        })
    }

    /// The point met by the ray after all decisions of the trail, and that ray.
    fn hit(&mut self, case: &Case<'_>, decision: Decision) -> Result<(&ExactHit<N>, &ExactRay<N>), Unsure> {
        self.ray(case)?;
        Ok((Self::met(&mut self.hit, &self.ray, case, decision)?, &self.ray))
    }

    /// The path in other numbers from where it is, what they hold taken as it is.
    fn taken_as_it_is<const M: usize>(&self) -> ExactPath<M> {
        ExactPath::new(self.done, self.ray.resize().taken_as_it_is())
    }
}

/// Where a path begins.
#[derive(Clone, Copy)]
pub(crate) enum Start {
    /// At the camera, through a point of the image plane.
    Camera(PlanePoint),
    /// As a ray of f64 that is taken as it is, and the surface it leaves: too little light goes along it for its
    /// errors to show.
    Given(Ray, Option<Decision>),
}

/// What is asked about: a path, by its decisions so far, which only ever grow.
#[derive(Clone, Copy)]
pub(crate) struct Case<'a> {
    pub(crate) tracer: &'a Tracer,
    pub(crate) start: Start,
    pub(crate) trail: &'a [Decision],
}

impl<'a> Case<'a> {
    /// The path by what it is made of, for proofs: of a ray that is taken as it is, there is nothing to prove.
    fn path(&self) -> Result<CameraPath<'a>, Unsure> {
        let Case { tracer, start: Start::Camera(point), trail } = *self else { return Err(Unsure) };
        let (scene, view) = (&*tracer.prepared.scene, &tracer.settings.view);
        Ok(CameraPath { scene, view, grid: tracer.grid, point: [point.x, point.y], trail })
    }

    /// The path's first ray.
    fn first_ray<const N: usize>(&self) -> ExactRay<N> {
        match self.start {
            Start::Camera(point) => self.tracer.frame.exact_ray(point),
            Start::Given(ray, from) => {
                let PreparedScene { local, scene, .. } = &*self.tracer.prepared;
                let away = Vector::new(ray.o.to_dvec3()).scale(i64::from(local.power));
                let ray = ExactRay::new(scene.camera().location(), Vector::new(ray.d.to_dvec3()));
                ExactRay { o: ray.o + away, from, ..ray.taken_as_it_is() }
            }
        }
    }
}

/// A question about a path, put at one width.
trait Question {
    type Answer;
    /// By numbers and the bounds that exact arithmetic derives.
    fn ask<const N: usize>(&self, case: &Case<'_>, path: &mut ExactPath<N>) -> Result<Self::Answer, Unsure>;
    /// By numbers that prove what is zero.
    fn prove<const N: usize>(&self, case: &Case<'_>) -> Result<Self::Answer, Unsure>;
}

/// Which of some objects the path meets next.
struct Closest<'a>(&'a [ObjectId]);

impl Question for Closest<'_> {
    type Answer = Option<Decision>;
    fn ask<const N: usize>(&self, case: &Case<'_>, path: &mut ExactPath<N>) -> Result<Option<Decision>, Unsure> {
        let found = exact::closest(&case.tracer.prepared, path.ray(case)?, self.0.iter().copied())?;
        Ok(found.map(|(decision, _)| decision))
    }
    fn prove<const N: usize>(&self, case: &Case<'_>) -> Result<Option<Decision>, Unsure> {
        Proof::<N>::new(&case.path()?, self.0, &[])?.closest(self.0)
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
    fn ask<const N: usize>(&self, case: &Case<'_>, path: &mut ExactPath<N>) -> Result<bool, Unsure> {
        let segment = path.hit(case, self.met)?.0.towards(self.light);
        exact::occluded(&case.tracer.prepared, &segment, self.candidates.iter().copied())
    }
    fn prove<const N: usize>(&self, case: &Case<'_>) -> Result<bool, Unsure> {
        let objects: Vec<_> = self.candidates.iter().copied().chain([self.met.id]).collect();
        Proof::<N>::new(&case.path()?, &objects, &[self.light])?.occluded(self.met, self.light, self.candidates)
    }
}

/// The point met, and the direction mirrored there if that is `mirrored` on.
struct Hit {
    met: Decision,
    mirrored: bool,
}

/// What is seen of a place whose rounding would be too much for what is computed from it.
#[derive(Debug)]
pub(crate) struct Values {
    /// n · l towards each light of the scene.
    pub(crate) cosines: Vec<f64>,
    /// Where a picture is read there, if one is.
    pub(crate) uv: DVec2,
}

impl Hit {
    /// What is seen at `hit`, met along `d`; `proof` knows exact events there.
    fn seen<const N: usize>(
        &self,
        case: &Case<'_>,
        hit: &ExactHit<N>,
        d: &Vector<N>,
        proof: Option<(&Proof<'_, N>, &Point<N>)>,
    ) -> Result<Refined, Unsure> {
        let tracer = case.tracer;
        let scene = &tracer.prepared.scene;
        let (p, n) = (hit.in_local_space(&tracer.prepared.local, scene)?, hit.normal()?);
        let is_at = |light| proof.map_or(Err(Unsure), |(proof, point)| proof.is_at(point, light));
        let cosine = |&light: &DVec3| match hit.cosine(light) {
            Err(Unsure) if is_at(light)? => Ok(0.0),
            known => known,
        };
        let cosines = scene.lights().iter().map(cosine).collect::<Result<_, _>>()?;
        let pictured = tracer.is_pictured(self.met.id.0);
        let uv = match pictured.then(|| texture::exact_coordinates(scene, &tracer.mappings, hit)) {
            Some(Err(Unsure)) => {
                let (proof, point) = proof.ok_or(Unsure)?;
                sphere::texture::pole(proof.at_pole(point, self.met)?)
            }
            Some(Ok(uv)) => uv,
            None => DVec2::ZERO,
        };
        let mirrored = if self.mirrored { hit.mirrored(d)? } else { DVec3::ZERO };
        let interaction = SurfaceInteraction::rounded(V3::splat(p), V3::splat(n));
        Ok(Refined { interaction, mirrored, turn: 4.0 * U, hit: Some(Values { cosines, uv }) })
    }
}

impl Question for Hit {
    type Answer = Refined;
    fn ask<const N: usize>(&self, case: &Case<'_>, path: &mut ExactPath<N>) -> Result<Refined, Unsure> {
        let (hit, ray) = path.hit(case, self.met)?;
        self.seen(case, hit, &ray.d, None)
    }
    fn prove<const N: usize>(&self, case: &Case<'_>) -> Result<Refined, Unsure> {
        let mut proof = Proof::<N>::new(&case.path()?, &[self.met.id], case.tracer.prepared.scene.lights())?;
        let (hit, d, point) = proof.hit(self.met)?;
        self.seen(case, &hit, &d, Some((&proof, &point)))
    }
}

/// A place that f64 alone would misplace.
pub(crate) struct Refined {
    pub(crate) interaction: SurfaceInteraction,
    /// The direction mirrored there, where it was asked for; rounded.
    pub(crate) mirrored: DVec3,
    /// Relative error of that direction.
    pub(crate) turn: f64,
    /// What is seen there, where the rounded place would not do.
    pub(crate) hit: Option<Values>,
}

/// Limbs of the numbers in which what is zero is proven, and the longest trails they are tried for.
///
/// Wider ones are dear, and after many mirrors no width would do.
const PROOFS: [(usize, usize); 4] = [(8, 4), (32, 12), (128, 6), (512, 3)];

/// The path in double-double and at both widths, each as far as it was needed.
#[derive(Default)]
pub(crate) struct Refiner {
    double: Option<DoubleDoublePath>,
    first: Option<ExactPath<FIRST>>,
    last: Option<Box<ExactPath<LAST>>>,
    /// From where the last width has used its digits up: any width is as good then.
    given: Option<ExactPath<FIRST>>,
    unresolved: bool,
}

impl Refiner {
    /// Whether something was asked that even the last width could not tell.
    pub(crate) fn unresolved(&self) -> bool {
        self.unresolved
    }

    fn ask<Q: Question>(&mut self, case: &Case<'_>, question: &Q) -> Option<Q::Answer> {
        let Case { tracer, trail, .. } = *case;
        if tracer.is_unwanted() {
            return None;
        }
        let first = self.first.get_or_insert_with(|| ExactPath::new(0, case.first_ray()));
        if let Ok(answer) = question.ask(case, first) {
            return Some(answer);
        }
        // What is open may be an exact event: short numbers show that at once.
        let within = PROOFS.map(|(_, longest)| trail.len() <= longest);
        if within[0]
            && let Ok(answer) = question.prove::<{ PROOFS[0].0 }>(case)
        {
            return Some(answer);
        }
        let last = self.last.get_or_insert_with(|| Box::new(ExactPath::new(0, case.first_ray())));
        if let Ok(answer) = question.ask(case, &mut **last) {
            return Some(answer);
        }
        let proven = within[1].then(|| question.prove::<{ PROOFS[1].0 }>(case).ok()).flatten();
        let proven = proven.or_else(|| within[2].then(|| question.prove::<{ PROOFS[2].0 }>(case).ok()).flatten());
        let proven = proven.or_else(|| within[3].then(|| question.prove::<{ PROOFS[3].0 }>(case).ok()).flatten());
        if proven.is_some() {
            return proven;
        }
        self.unresolved = true;
        let answer = if last.lost {
            question.ask(case, self.given.get_or_insert_with(|| last.taken_as_it_is()))
        } else {
            question.ask(case, &mut last.taken_as_it_is::<LAST>())
        };
        answer.ok()
    }

    /// Which of `candidates` the path meets next.
    pub(crate) fn closest(&mut self, case: &Case<'_>, candidates: &[ObjectId]) -> Option<Decision> {
        let double = self.double.get_or_insert_with(|| DoubleDoublePath::new(case));
        if let Some(answer) = double.closest(case, candidates) {
            return answer;
        }
        self.ask(case, &Closest(candidates)).flatten()
    }

    /// Whether one of `candidates` stands between the point met and the `light`-th light.
    pub(crate) fn occluded(&mut self, case: &Case<'_>, met: Decision, light: usize, candidates: &[ObjectId]) -> bool {
        let double = self.double.get_or_insert_with(|| DoubleDoublePath::new(case));
        if let Some(answer) = double.occluded(case, met, light, candidates) {
            return answer;
        }
        let light = case.tracer.prepared.scene.lights()[light];
        self.ask(case, &Occluded { met, light, candidates }).unwrap_or(false)
    }

    /// The place met, as right as f64 can say it, and, where it is asked for, the direction mirrored
    /// there. `throughput` is what the path has left of the light.
    pub(crate) fn interaction(
        &mut self,
        case: &Case<'_>,
        met: Decision,
        throughput: f64,
        mirrored: bool,
    ) -> Option<Refined> {
        let tracer = case.tracer;
        if !tracer.is_pictured(met.id.0)
            && let Some(refined) = self.double.get_or_insert_with(|| DoubleDoublePath::new(case)).interaction(case, met)
            && !tracer.too_wide(&refined.interaction, throughput)
        {
            return Some(refined);
        }
        self.ask(case, &Hit { met, mirrored })
    }
}

impl Tracer {
    /// Whether the values at `place` may be too far from the real ones for a picture.
    pub(super) fn too_wide(&self, interaction: &SurfaceInteraction, throughput: f64) -> bool {
        let lights = &self.prepared.local.lights;
        let first = self.prepared.local.nearest_light_at_first();
        let nearest = lights.iter().fold(first, |d, &l| shade::nearer(d, interaction, V3::splat(l)));
        !(shade::excess(interaction, nearest, throughput) <= 0.0)
    }
}
