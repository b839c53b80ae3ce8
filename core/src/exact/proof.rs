//! Questions about paths in numbers that prove what is zero.
//!
//! Where the bounds of exact arithmetic leave a sign open, it may be zero: an edge met exactly, two
//! surfaces at one distance, a start on a surface. Here the path is followed again in
//! [`Ball`]s, without a division: points are X/w, distances num/(w·den), directions have any length,
//! and all lengths are integers, scaled by one power of two. Every number is then an
//! algebraic integer, and what is zero is proven to be zero in numbers that are wide enough. How wide
//! grows with the digits of the scene's numbers and twofold with each nested root, the camera's two and
//! one for each curved mirror.

use std::cmp::Ordering;

use glam::DVec3;

use crate::numeric::{Ball, Balls, Bound, Roots, Unsure, Vector};
use crate::scene::Scene;
use crate::settings::View;
use crate::shapes::exact::ExactHit;
use crate::shapes::integers::{direction, lengths, to_integers};
use crate::shapes::proof::{self, Along, Line, Spot, intersect};
use crate::shapes::{Decision, Kind, ObjectId, kind, surface_and_order};

/// A point X/w, and the normal there.
pub(crate) struct Point<const N: usize> {
    x: Balls<N>,
    w: Ball<N>,
    n: Balls<N>,
}

/// A path from the camera, as far as it is decided.
#[derive(Clone, Copy)]
pub(crate) struct CameraPath<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) view: &'a View,
    /// Cells along a pixel's edge.
    pub(crate) grid: u32,
    /// The point of the image plane, to the right and up, in halves of a cell.
    pub(crate) point: [i32; 2],
    pub(crate) trail: &'a [Decision],
}

/// A path, and what is asked about it.
pub(crate) struct Proof<'a, const N: usize> {
    scene: &'a Scene,
    roots: Roots,
    line: Line<N>,
}

impl<'a, const N: usize> Proof<'a, N> {
    /// The path through a point after its trail, to be asked about `others` and `lights`.
    pub(crate) fn new(path: &CameraPath<'a>, others: &[ObjectId], lights: &[DVec3]) -> Result<Self, Unsure> {
        let CameraPath { scene, view, grid, point, trail } = *path;
        let camera = scene.camera();
        let objects = trail.iter().map(|d| d.id).chain(others.iter().copied());
        let points = lights.iter().copied().chain([camera.location(), camera.look_at()]).flat_map(|v| v.to_array());
        let scale = to_integers(objects.flat_map(|id| lengths(scene, id)).chain(points));
        let mut roots = Roots::default();
        let eye = Balls::scaled(camera.location(), scale);
        let f = Balls::scaled(camera.look_at(), scale) - eye;
        let right = direction(camera.sky()).cross(&f);
        let up = f.cross(&right);
        // zoom·f/|f| + (x·r/|r| + y·u/|u|)·height/units, times |f||r| and the units.
        let (far, long) = (f.dot(&f).sqrt(&mut roots), right.dot(&right).sqrt(&mut roots));
        let power = to_integers([view.zoom(), view.plane_height()]);
        let units = 2.0 * f64::from(grid) * f64::from(view.height());
        let (zoom, height) = (Ball::scaled(view.zoom(), power), Ball::scaled(view.plane_height(), power));
        let [x, y] = point.map(|x| Ball::integer(f64::from(x)));
        let d = f * (zoom * Ball::integer(units) * long) + right * (height * far * x) + up * (height * y);
        let line = Line { x: eye, w: Ball::integer(1.0), d, scale, from: None };
        let mut proof = Self { scene, roots, line };
        for &decision in trail {
            let spot = proof.spot(decision)?;
            proof.line = spot.reflect(&proof.line);
        }
        Ok(proof)
    }

    /// The ray from `origin` to `to`, or along that direction, to be asked about `others`; both end at 1.
    fn of_ray(scene: &'a Scene, origin: DVec3, to: To, others: &[ObjectId]) -> Self {
        let end = if let To::Point(p) = to { p } else { DVec3::ZERO };
        let points = [origin, end].into_iter().flat_map(|v| v.to_array());
        let mut scale = to_integers(others.iter().flat_map(|&id| lengths(scene, id)).chain(points));
        let d = match to {
            To::Point(p) => Balls::scaled(p, scale) - Balls::scaled(origin, scale),
            To::Direction(d) => {
                scale = scale.max(to_integers(d.to_array()));
                Balls::scaled(d, scale)
            }
        };
        let line = Line { x: Balls::scaled(origin, scale), w: Ball::integer(1.0), d, scale, from: None };
        Self { scene, roots: Roots::default(), line }
    }

    /// Which of `candidates` the line meets first; equal distances go to the first in the document.
    pub(crate) fn closest(&mut self, candidates: &[ObjectId]) -> Result<Option<Decision>, Unsure> {
        Ok(self.first(candidates)?.map(|(_, decision)| decision))
    }

    fn first(&mut self, candidates: &[ObjectId]) -> Result<Option<(Along<N>, Decision)>, Unsure> {
        let mut best: Option<(Along<N>, Decision, u32)> = None;
        for &id in candidates {
            let Some((along, inside)) = intersect(self.scene, &self.line, id, &mut self.roots)? else {
                continue;
            };
            let order = surface_and_order(self.scene, id).1;
            let nearer = match &best {
                None => true,
                Some((least, _, first)) => along.compare(least)?.then(order.cmp(first)) == Ordering::Less,
            };
            if nearer {
                best = Some((along, Decision { id, inside }, order));
            }
        }
        Ok(best.map(|(along, decision, _)| (along, decision)))
    }

    /// Whether one of `candidates` stands between the point of `met` and `light`.
    pub(crate) fn occluded(&mut self, met: Decision, light: DVec3, candidates: &[ObjectId]) -> Result<bool, Unsure> {
        let spot = self.spot(met)?;
        let d = Balls::scaled(light, self.line.scale) * spot.w - spot.x;
        self.line = Line { x: spot.x, w: spot.w, d, from: Some(met), ..self.line };
        self.blocked(candidates)
    }

    /// Whether one of `candidates` stands on the line before 1.
    fn blocked(&mut self, candidates: &[ObjectId]) -> Result<bool, Unsure> {
        let light = Along { num: Ball::integer(1.0), den: Ball::integer(1.0) };
        let mut open = false;
        for &id in candidates {
            let met = intersect(self.scene, &self.line, id, &mut self.roots);
            match met.and_then(|m| m.map_or(Ok(false), |(t, _)| Ok(t.compare(&light)?.is_lt()))) {
                Ok(true) => return Ok(true),
                Ok(false) => {}
                Err(Unsure) => open = true,
            }
        }
        if open { Err(Unsure) } else { Ok(false) }
    }

    /// Whether the point is that of `light`.
    pub(crate) fn is_at(&self, point: &Point<N>, light: DVec3) -> Result<bool, Unsure> {
        let away = Balls::scaled(light, self.line.scale) * point.w - point.x;
        for c in away.0 {
            if c.sign()? != 0 {
                return Err(Unsure);
            }
        }
        Ok(true)
    }

    /// At which pole of the sphere of `met` the point is: 1, or −1 for the one across; unsure elsewhere.
    pub(crate) fn at_pole(&self, point: &Point<N>, met: Decision) -> Result<i32, Unsure> {
        let (Kind::Sphere, i) = kind(self.scene, met.id) else { return Err(Unsure) };
        let pole = direction(self.scene.orientation(i as u32).ok_or(Unsure)?.pole);
        for c in point.n.cross(&pole).0 {
            if c.sign()? != 0 {
                return Err(Unsure);
            }
        }
        point.n.dot(&pole).sign()
    }

    /// The point where the line meets `met`, known to be what it meets.
    fn spot(&mut self, met: Decision) -> Result<Spot<N>, Unsure> {
        proof::spot(self.scene, &self.line, met, &mut self.roots)
    }

    /// The point where the line meets `met`: in world space, with the line's direction, and as it is.
    pub(crate) fn hit(&mut self, met: Decision) -> Result<(ExactHit<N>, Vector<N>, Point<N>), Unsure> {
        let spot = self.spot(met)?;
        let d = self.line.d;
        // Enough for f64s, and more for what is subtracted from them.
        if !d.is_known_to(80) || !spot.w.is_known_to(80) || !spot.n.is_known_to(80) {
            return Err(Unsure);
        }
        let shrink = -self.line.scale;
        let w = *spot.w.mid();
        let p = spot.x.mid();
        let rounding = Bound::rounding::<N>();
        let reach = p.0.iter().fold(Bound::ZERO, |sum, x| sum + Bound::of(x)).over(&w);
        let error = spot.x.error().over(&w) + reach * (spot.w.error().over(&w) + rounding);
        let unit = |v: Vector<N>| v.scale(-v.exponent());
        let (n, d) = (unit(spot.n.mid()), unit(d.mid()));
        let back = n.dot(&d).scale(1).over(n.dot(&n));
        let p = Vector(p.0.map(|x| x.over(w).scale(shrink)));
        let place = error.scale(shrink + 1);
        let hit = ExactHit::known(p, place, (n, Bound::power(-76)), back, spot.turned, met);
        Ok((hit, d, Point { x: spot.x, w: spot.w, n: spot.n }))
    }
}

/// Where a ray goes.
#[derive(Clone, Copy)]
enum To {
    Point(DVec3),
    Direction(DVec3),
}

/// A question whose answer is proven in numbers of some width.
trait Proving {
    type Answer;
    fn prove<const N: usize>(&self) -> Result<Self::Answer, Unsure>;
}

/// The answer in the narrowest numbers that know it.
fn prove<P: Proving>(question: &P) -> Option<P::Answer> {
    let narrow = question.prove::<8>().or_else(|Unsure| question.prove::<32>());
    narrow.or_else(|Unsure| question.prove::<128>()).or_else(|Unsure| question.prove::<512>()).ok()
}

/// What a ray meets first, among some objects.
struct First<'a> {
    scene: &'a Scene,
    origin: DVec3,
    direction: DVec3,
    candidates: &'a [ObjectId],
}

impl Proving for First<'_> {
    type Answer = Option<(ObjectId, f64)>;
    fn prove<const N: usize>(&self) -> Result<Self::Answer, Unsure> {
        let mut proof = Proof::<N>::of_ray(self.scene, self.origin, To::Direction(self.direction), self.candidates);
        let Some((Along { num, den }, met)) = proof.first(self.candidates)? else { return Ok(None) };
        let known = num.is_known_to(60) && den.is_known_to(60);
        if known { Ok(Some((met.id, num.mid().over(*den.mid()).to_f64()))) } else { Err(Unsure) }
    }
}

/// Which of `candidates` the ray from `origin` along `direction` meets first, and where; `None` where it is
/// not found out.
pub(crate) fn closest_hit(
    scene: &Scene,
    origin: DVec3,
    direction: DVec3,
    candidates: &[ObjectId],
) -> Option<Option<(ObjectId, f64)>> {
    prove(&First { scene, origin, direction, candidates })
}

/// Whether one of some objects meets the open segment between two points.
struct Between<'a> {
    scene: &'a Scene,
    ends: [DVec3; 2],
    candidates: &'a [ObjectId],
}

impl Proving for Between<'_> {
    type Answer = bool;
    fn prove<const N: usize>(&self) -> Result<bool, Unsure> {
        let [from, to] = self.ends;
        Proof::<N>::of_ray(self.scene, from, To::Point(to), self.candidates).blocked(self.candidates)
    }
}

/// Whether one of `candidates` meets the open segment between two points; `None` where it is not found out.
pub(super) fn is_between(scene: &Scene, ends: [DVec3; 2], candidates: &[ObjectId]) -> Option<bool> {
    prove(&Between { scene, ends, candidates })
}
