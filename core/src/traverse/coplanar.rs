//! Which planes and triangles lie in one exact plane, and which lights and eyes lie there too.
//!
//! Where they do, what would take wide numbers for every ray is known for all of them: of two surfaces
//! in one plane the first in the document is met, a ray that starts in a plane does not meet it, and a segment
//! that ends in a plane meets it at its end alone. Objects are looked at when something about
//! them is in doubt, once each. Planes square to an axis are named by it and by where they cross it. Of others,
//! equal ones have equal residues modulo a prime, by which they are found; that they are equal is then proven.

mod residue;

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use glam::DVec3;

use super::prepared::PreparedScene;
use crate::numeric::{Ball, Balls, Unsure, V3, zero_area};
use crate::scene::{PlanePosition, Scene};
use crate::shapes::integers::{direction, lengths, to_integers};
use crate::shapes::{Decision, Kind, Local, ObjectId, kind};
use residue::Residue;

/// The plane holds the eye.
const EYE: u32 = 1 << 30;
/// The plane holds a light.
const LIT: u32 = 1 << 31;
/// One more than the plane's number.
const NUMBER: u32 = EYE - 1;

/// So many planes that hold lights are told apart from those that hold none; their numbers come first.
const LIT_PLANES: u32 = 1 << 8;

/// The exact planes that objects were found to lie in.
#[derive(Debug)]
pub(crate) struct Coplanar {
    /// What is known of each plane and each triangle; 0 where nothing is.
    facts: Vec<AtomicU32>,
    /// How many planes there are, and spheres behind them.
    counts: [u32; 2],
    /// Whether a plane was found in which several objects lie, or one with the eye or a light.
    matters: AtomicBool,
    known: Mutex<Known>,
    /// By their numbers, the lights in planes that hold some, a bit each.
    lights: Vec<OnceLock<Vec<u64>>>,
    /// By light, the infinite planes that hold it; shorter where there are none.
    planes: Vec<Vec<u32>>,
}

#[derive(Debug, Default)]
struct Known {
    /// By their residues, the planes' numbers, facts, and an object in each.
    planes: HashMap<[u64; 4], Vec<(u32, ObjectId)>>,
    /// Planes without a light, and with some.
    counts: [u32; 2],
}

impl Coplanar {
    pub(crate) fn new(scene: &Scene, local: &Local) -> Self {
        let flat = scene.planes().len() + scene.triangles().len();
        let mut planes = Vec::new();
        for i in 0..scene.planes().len() as u32 {
            for (k, (&light, &at)) in scene.lights().iter().zip(&local.lights).enumerate() {
                if !is_clearly_off(local, scene, ObjectId(i), at) && holds(scene, ObjectId(i), light) {
                    planes.resize_with(planes.len().max(k + 1), Vec::new);
                    planes[k].push(i);
                }
            }
        }
        Self {
            facts: (0..flat).map(|_| AtomicU32::new(0)).collect(),
            counts: [scene.planes().len() as u32, scene.spheres().len() as u32],
            matters: AtomicBool::new(false),
            known: Mutex::default(),
            lights: (0..LIT_PLANES).map(|_| OnceLock::new()).collect(),
            planes,
        }
    }

    fn facts(&self, id: ObjectId) -> Option<&AtomicU32> {
        let [planes, spheres] = self.counts;
        match id.0.checked_sub(planes) {
            None => self.facts.get(id.0 as usize),
            Some(i) => i.checked_sub(spheres).and_then(|i| self.facts.get((planes + i) as usize)),
        }
    }

    /// Whether anything was found yet that [`Self::known`] might tell.
    pub(crate) fn matters(&self) -> bool {
        self.matters.load(Ordering::Relaxed)
    }

    /// The plane of `id`, if that was asked about before.
    pub(crate) fn known(&self, id: ObjectId) -> Option<FlatPlane> {
        let facts = self.facts(id)?.load(Ordering::Relaxed);
        // Of planes beyond all numbers nothing is known.
        (facts != 0 && facts & NUMBER != NUMBER).then_some(FlatPlane(facts))
    }

    /// Whether the `light`-th light is in `plane`.
    pub(crate) fn holds_light(&self, plane: FlatPlane, light: usize) -> bool {
        plane.0 & LIT != 0
            && self.lights[(plane.0 & NUMBER) as usize]
                .get()
                .is_some_and(|bits| bits[light / 64] >> (light % 64) & 1 == 1)
    }
}

/// An exact plane, and what it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FlatPlane(u32);

impl FlatPlane {
    /// Its number, never 0.
    pub(crate) fn number(self) -> u32 {
        self.0 & NUMBER
    }

    pub(crate) fn holds_eye(self) -> bool {
        self.0 & EYE != 0
    }
}

impl PreparedScene {
    /// The plane in which `id` lies; `None` for spheres.
    pub(crate) fn plane_of(&self, id: ObjectId) -> Option<FlatPlane> {
        let facts = self.coplanar.facts(id)?;
        if facts.load(Ordering::Relaxed) == 0 {
            facts.store(self.look_at_plane_of(id), Ordering::Relaxed);
        }
        self.coplanar.known(id)
    }

    #[cold]
    fn look_at_plane_of(&self, id: ObjectId) -> u32 {
        let scene = &*self.scene;
        let axial = square_to_axis(scene, id);
        let key = axial.unwrap_or_else(|| residues(scene, id));
        let mut known = self.coplanar.known.lock().unwrap_or_else(PoisonError::into_inner);
        let Known { planes, counts } = &mut *known;
        let same = planes.entry(key).or_default();
        let matters = || self.coplanar.matters.store(true, Ordering::Relaxed);
        if let Some((facts, _)) = same.iter().find(|(_, other)| axial.is_some() || are_coplanar(scene, id, *other)) {
            matters();
            return *facts;
        }
        let holds = |p: DVec3, local: DVec3| !is_clearly_off(&self.local, scene, id, local) && holds(scene, id, p);
        let mut bits = vec![0u64; scene.lights().len().div_ceil(64)];
        let mut lit = false;
        for (k, (&light, &local)) in scene.lights().iter().zip(&self.local.lights).enumerate() {
            if holds(light, local) {
                bits[k / 64] |= 1 << (k % 64);
                lit = true;
            }
        }
        // Of lit planes beyond their numbers it is not known that they are lit.
        let lit = lit && counts[1] + 1 < LIT_PLANES;
        let count = &mut counts[usize::from(lit)];
        *count = (*count + 1).min(NUMBER - LIT_PLANES);
        let mut facts = *count;
        if lit {
            let _ = self.coplanar.lights[facts as usize].set(bits);
            facts |= LIT;
        } else {
            facts += LIT_PLANES;
        }
        if holds(scene.camera().location(), DVec3::ZERO) {
            facts |= EYE;
        }
        if facts & (LIT | EYE) != 0 {
            matters();
        }
        same.push((facts, id));
        facts
    }

    /// Whether `a` and `b` lie in one plane.
    pub(crate) fn are_coplanar(&self, a: ObjectId, b: ObjectId) -> bool {
        self.plane_of(a).is_some_and(|plane| self.plane_of(b).is_some_and(|o| plane.number() == o.number()))
    }

    /// The infinite planes that hold the `light`-th light.
    pub(crate) fn planes_with_light(&self, light: usize) -> &[u32] {
        self.coplanar.planes.get(light).map_or(&[], |planes| planes)
    }

    /// Whether the eye is in the plane of `id`.
    pub(crate) fn has_eye_in_plane(&self, id: ObjectId) -> bool {
        self.plane_of(id).is_some_and(FlatPlane::holds_eye)
    }

    /// Whether the `light`-th light is in the plane of `id`.
    pub(crate) fn has_light_in_plane(&self, id: ObjectId, light: usize) -> bool {
        self.plane_of(id).is_some_and(|plane| self.coplanar.holds_light(plane, light))
    }

    /// Whether a ray that starts on `from`, or at the eye, cannot meet `id` since its start is in that plane.
    pub(crate) fn starts_in_plane(&self, from: Option<Decision>, at_eye: bool, id: ObjectId) -> bool {
        match from {
            Some(from) => self.are_coplanar(from.id, id),
            None => at_eye && self.has_eye_in_plane(id),
        }
    }
}

/// What a scene's exact planes are like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SharedPlanes {
    /// Planes in which more than one object lies.
    pub planes: usize,
    /// Objects in them.
    pub objects: usize,
    /// Planes that hold a light.
    pub lit: usize,
    /// Planes that hold the eye.
    pub seen_edge_on: usize,
}

impl PreparedScene {
    /// Looks at every plane and triangle that has an area.
    pub(crate) fn shared_planes(&self) -> SharedPlanes {
        let scene = &*self.scene;
        let first = scene.planes().len() + scene.spheres().len();
        let triangles = (0..scene.triangles().len()).filter(|&i| {
            let t = &scene.triangles()[i];
            !zero_area::is_zero(&t.written, t.by_sides())
        });
        let ids = (0..scene.planes().len()).chain(triangles.map(|i| first + i));
        let mut planes: HashMap<u32, usize> = HashMap::new();
        for FlatPlane(facts) in ids.filter_map(|id| self.plane_of(ObjectId(id as u32))) {
            *planes.entry(facts).or_default() += 1;
        }
        let mut shared = SharedPlanes::default();
        for (facts, objects) in planes {
            if objects > 1 {
                shared.planes += 1;
                shared.objects += objects;
            }
            shared.lit += usize::from(facts & LIT != 0);
            shared.seen_edge_on += usize::from(facts & EYE != 0);
        }
        shared
    }
}

/// Which axis the plane of `id` is square to, and where it crosses that: a name of its own, that no residues are.
fn square_to_axis(scene: &Scene, id: ObjectId) -> Option<[u64; 4]> {
    let name = |axis: usize, at: f64| Some([u64::MAX, axis as u64, (at + 0.0).to_bits(), 0]);
    match kind(scene, id) {
        Kind::Plane(i) | Kind::Sphere(i) => {
            let plane = &scene.planes()[i];
            let n = plane.normal;
            let axis = (0..3).find(|&k| (0..3).all(|j| (n[j] == 0.0) == (j != k)))?;
            match plane.position {
                PlanePosition::Point(q) => name(axis, q[axis]),
                PlanePosition::Distance(d) => name(axis, if n[axis] < 0.0 { -d } else { d }),
            }
        }
        Kind::Triangle(i) => {
            let t = &scene.triangles()[i];
            let [a, b, c] = t.written;
            let level = |k: usize| if t.by_sides() { b[k] == 0.0 && c[k] == 0.0 } else { a[k] == b[k] && a[k] == c[k] };
            let axis = (0..3).find(|&k| level(k))?;
            name(axis, a[axis])
        }
    }
}

/// The normal's ratios and the offset's square over the normal's, which may be irrational itself.
fn residues(scene: &Scene, id: ObjectId) -> [u64; 4] {
    let of = |v: DVec3| v.to_array().map(Residue::of);
    let dot = |a: [Residue; 3], b: [Residue; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (n, square) = match kind(scene, id) {
        Kind::Plane(i) | Kind::Sphere(i) => {
            let plane = &scene.planes()[i];
            let n = of(plane.normal);
            match plane.position {
                PlanePosition::Point(q) => (n, dot(n, of(q)) * dot(n, of(q))),
                PlanePosition::Distance(d) => (n, Residue::of(d) * Residue::of(d) * dot(n, n)),
            }
        }
        Kind::Triangle(i) => {
            let t = &scene.triangles()[i];
            let [a, b, c] = t.written.map(of);
            let side = |v: [Residue; 3]| if t.by_sides() { v } else { [0, 1, 2].map(|k| v[k] - a[k]) };
            let (u, v) = (side(b), side(c));
            let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            (n, dot(n, a) * dot(n, a))
        }
    };
    let pivot = n.into_iter().find(|x| x.0 != 0).unwrap_or(Residue(0)).inverse();
    [n[0] * pivot, n[1] * pivot, n[2] * pivot, square * pivot * pivot].map(|r| r.0)
}

/// Whether rounding alone shows that `point` is not in the plane of `id`; both in local space.
fn is_clearly_off(local: &Local, scene: &Scene, id: ObjectId, point: DVec3) -> bool {
    let p = V3::splat(point);
    let (distance, terms) = match kind(scene, id) {
        Kind::Plane(i) | Kind::Sphere(i) => {
            let plane = &local.planes[i];
            (plane.n.dot(p) - plane.h, p.norm1() + plane.h.abs())
        }
        Kind::Triangle(i) => {
            let [a, b, c] = local.triangle(&scene.triangles()[i]).v;
            let reach = a.norm1() + b.norm1() + c.norm1() + p.norm1();
            let (u, v) = (b - a, c - a);
            (u.cross(v).dot(p - a), (u.norm1() + v.norm1()) * (u.norm1() + v.norm1() + reach) * reach)
        }
    };
    distance.abs() > 1e-12 * terms && terms < 1e100 && distance.abs() > 1e-100
}

/// A plane n · P = offset in integers: the offset's sign and square.
struct Flat<const N: usize> {
    n: Balls<N>,
    offset: Offset<N>,
}

enum Offset<const N: usize> {
    Rational(Ball<N>),
    /// Sign and square.
    Root(i32, Ball<N>),
}

impl<const N: usize> Flat<N> {
    fn new(scene: &Scene, id: ObjectId, scale: i64) -> Self {
        match kind(scene, id) {
            Kind::Plane(i) | Kind::Sphere(i) => {
                let plane = &scene.planes()[i];
                let n = direction(plane.normal);
                let offset = match plane.position {
                    PlanePosition::Point(q) => Offset::Rational(n.dot(&Balls::scaled(q, scale))),
                    PlanePosition::Distance(d) => {
                        let far = Ball::scaled(d, scale);
                        Offset::Root(far.mid().signum(), far * far * n.dot(&n))
                    }
                };
                Self { n, offset }
            }
            Kind::Triangle(i) => {
                let t = &scene.triangles()[i];
                let [a, b, c] = t.written.map(|v| Balls::scaled(v, scale));
                let n = if t.by_sides() { b.cross(&c) } else { (b - a).cross(&(c - a)) };
                Self { n, offset: Offset::Rational(n.dot(&a)) }
            }
        }
    }

    fn square(&self) -> Result<(i32, Ball<N>), Unsure> {
        Ok(match &self.offset {
            Offset::Rational(x) => (x.sign()?, *x * *x),
            Offset::Root(sign, square) => (*sign, *square),
        })
    }

    fn is(&self, o: &Self) -> Result<bool, Unsure> {
        for c in self.n.cross(&o.n).0 {
            if c.sign()? != 0 {
                return Ok(false);
            }
        }
        // A component that is not zero.
        let Some(k) = (0..3).find(|&k| !matches!(self.n.0[k].sign(), Ok(0))) else { return Ok(false) };
        let (a, b) = (self.n.0[k], o.n.0[k]);
        if let (Offset::Rational(x), Offset::Rational(y)) = (&self.offset, &o.offset) {
            return Ok((*x * b - *y * a).sign()? == 0);
        }
        let ((sign, square), (other_sign, other)) = (self.square()?, o.square()?);
        Ok(sign * b.sign()? == other_sign * a.sign()? && (square * b * b - other * a * a).sign()? == 0)
    }

    fn holds(&self, p: &Balls<N>) -> Result<bool, Unsure> {
        let at = self.n.dot(p);
        if let Offset::Rational(x) = &self.offset {
            return Ok((at - *x).sign()? == 0);
        }
        let (sign, square) = self.square()?;
        Ok(at.sign()? == sign && (at * at - square).sign()? == 0)
    }
}

/// The first certain answer, in wider and wider numbers: in the last nothing is rounded.
macro_rules! exactly {
    ($n:ident => $e:expr) => {{
        fn no(_: Unsure) -> bool {
            false
        }
        let answer = { const $n: usize = 8; $e };
        let answer = answer.or_else(|_: Unsure| { const $n: usize = 24; $e });
        answer.or_else(|_: Unsure| { const $n: usize = 512; $e }).unwrap_or_else(no)
    }};
}

fn are_coplanar(scene: &Scene, a: ObjectId, b: ObjectId) -> bool {
    let scale = to_integers(lengths(scene, a).chain(lengths(scene, b)));
    exactly!(N => Flat::<N>::new(scene, a, scale).is(&Flat::new(scene, b, scale)))
}

fn holds(scene: &Scene, id: ObjectId, p: DVec3) -> bool {
    let scale = to_integers(lengths(scene, id).chain(p.to_array()));
    exactly!(N => Flat::<N>::new(scene, id, scale).holds(&Balls::scaled(p, scale)))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::scene::{SceneBuilder, Surface};

    /// Planes by point, by distance and triangles, in any form and at any scale, are one plane where they are.
    #[test]
    fn one_plane_is_known_in_all_its_forms() {
        let mut b = SceneBuilder::new();
        b.camera(DVec3::new(3.0, 0.0, 0.0), DVec3::Y, DVec3::ZERO).expect("a camera");
        let s = b.surface(Surface::default()).expect("a surface");
        let v = DVec3::new;
        b.light(v(1.0, 1.0, 1.0)).expect("a light");
        b.light(v(1.0, 1.0, 1.0 + f64::EPSILON)).expect("a light");
        // x + y + z = 3, irrational and not.
        let through = PlanePosition::Point(v(0.0, 3.0, 0.0));
        b.plane(v(1.0, 1.0, 1.0), through, s).expect("a plane");
        b.plane(v(-2e300, -2e300, -2e300), PlanePosition::Point(v(0.0, 0.0, 3.0)), s).expect("a plane");
        b.plane(v(1.0, 1.0, 1.0), PlanePosition::Distance(3f64.sqrt()), s).expect("a plane");
        // 3x + 4y = 25 by distance 5, and its other side.
        b.plane(v(3.0, 4.0, 0.0), PlanePosition::Distance(5.0), s).expect("a plane");
        b.plane(v(-0.3e-5 * 2.0, 0.0, 0.0), PlanePosition::Distance(-3.0), s).expect("a plane");
        b.plane(v(3.0, 4.0, 0.0), PlanePosition::Distance(-5.0), s).expect("a plane");
        b.triangle([v(1.0, 1.0, 1.0), v(3.0, 0.0, 0.0), v(0.0, 3.0, 0.0)], s).expect("a triangle");
        b.triangle_by_sides(v(0.5, 0.5, 2.0), [v(1.0, -1.0, 0.0), v(0.0, 1.0, -1.0)], s).expect("a triangle");
        b.triangle([v(1.0, 1.0, 1.0), v(3.0, 0.0, 5e-324), v(0.0, 3.0, 0.0)], s).expect("a triangle");
        b.triangle([v(3.0, 4.0, 0.0), v(3.0, 4.0, 9.0), v(-1.0, 7.0, 0.0)], s).expect("a triangle");
        b.triangle([v(3.0, 0.0, 0.0), v(3.0, 4.0, 9.0), v(3.0, 7.0, 0.0)], s).expect("a triangle");
        let prepared = PreparedScene::build(Arc::new(b.finish().expect("a scene")));
        let same = |a: u32, b: u32| prepared.are_coplanar(ObjectId(a), ObjectId(b));
        for (a, b) in [(0, 1), (0, 6), (6, 7), (1, 7), (3, 9), (4, 10)] {
            assert!(same(a, b), "{a} and {b} are one plane");
        }
        for (a, b) in [(0, 2), (2, 6), (3, 5), (5, 9), (0, 3), (6, 8), (0, 8), (9, 10)] {
            assert!(!same(a, b), "{a} and {b} are two planes");
        }
        let eye = |a: u32| prepared.has_eye_in_plane(ObjectId(a));
        assert!(eye(0) && eye(7) && eye(4) && eye(10) && !eye(8) && !eye(3));
        let light = |a: u32, k: usize| prepared.has_light_in_plane(ObjectId(a), k);
        assert!(light(0, 0) && light(7, 0) && !light(0, 1) && !light(2, 0) && light(8, 0) && !light(8, 1));
    }
}
