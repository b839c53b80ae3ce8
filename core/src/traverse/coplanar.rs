//! Which planes and triangles lie in one exact plane, and which lights and eyes lie there too.
//!
//! Where they do, what would take wide numbers for every ray is known for all of them: of two surfaces
//! in one plane the first in the document is met, a ray that starts in a plane does not meet it, and a segment
//! that ends in a plane meets it at its end alone. Objects are looked at when something about
//! them is in doubt, once each. Planes square to an axis are named by it and by where they cross it. Of others,
//! equal ones have equal residues modulo a prime, by which they are found; that they are equal is then proven.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use glam::DVec3;

use super::prepared::PreparedScene;
use crate::numeric::{Balls, Unsure, V3};
use crate::scene::{Scene, Triangle};
use crate::shapes::coplanar::FlatObject;
use crate::shapes::integers::to_integers;
use crate::shapes::{Decision, Listed, Local, ObjectId, triangle};

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
    /// How many planes there are, and objects between them and triangles.
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
        for (i, plane) in scene.planes().iter().zip(&local.planes).enumerate() {
            let plane = FlatObject::Plane(plane.0, plane.1);
            for (k, (&light, &at)) in scene.lights().iter().zip(&local.lights).enumerate() {
                if !is_clearly_off(&plane, local, at) && holds(&plane, light) {
                    planes.resize_with(planes.len().max(k + 1), Vec::new);
                    planes[k].push(i as u32);
                }
            }
        }
        Self {
            facts: (0..flat).map(|_| AtomicU32::new(0)).collect(),
            counts: [scene.planes().len() as u32, Triangle::first(scene) - scene.planes().len() as u32],
            matters: AtomicBool::new(false),
            known: Mutex::default(),
            lights: (0..LIT_PLANES).map(|_| OnceLock::new()).collect(),
            planes,
        }
    }

    fn facts(&self, id: ObjectId) -> Option<&AtomicU32> {
        let [planes, others] = self.counts;
        match id.0.checked_sub(planes) {
            None => self.facts.get(id.0 as usize),
            Some(i) => i.checked_sub(others).and_then(|i| self.facts.get((planes + i) as usize)),
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
        let Some(object) = FlatObject::of(scene, &self.local, id) else { return 0 };
        // A name of its own, that no residues are.
        let axial = object.square_to_axis().map(|(axis, at)| [u64::MAX, axis as u64, (at + 0.0).to_bits(), 0]);
        let key = axial.unwrap_or_else(|| object.residues());
        let mut known = self.coplanar.known.lock().unwrap_or_else(PoisonError::into_inner);
        let Known { planes, counts } = &mut *known;
        let same = planes.entry(key).or_default();
        let matters = || self.coplanar.matters.store(true, Ordering::Relaxed);
        let is_in_one_plane =
            |other| FlatObject::of(scene, &self.local, other).is_some_and(|other| are_coplanar(&object, &other));
        if let Some((facts, _)) = same.iter().find(|(_, other)| axial.is_some() || is_in_one_plane(*other)) {
            matters();
            return *facts;
        }
        let holds = |p: DVec3, local: DVec3| !is_clearly_off(&object, &self.local, local) && holds(&object, p);
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
        let first = Triangle::first(scene) as usize;
        let triangles = (0..scene.triangles().len()).filter(|&i| {
            let t = &scene.triangles()[i];
            !triangle::bounds::has_no_area(t)
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

/// Whether rounding alone shows that `point` is not in the plane of `object`; both in local space.
fn is_clearly_off(object: &FlatObject<'_>, local: &Local, point: DVec3) -> bool {
    let (distance, terms) = object.distance(local, V3::splat(point));
    distance.abs() > 1e-12 * terms && terms < 1e100 && distance.abs() > 1e-100
}

fn are_coplanar(a: &FlatObject<'_>, b: &FlatObject<'_>) -> bool {
    let scale = to_integers(a.lengths().chain(b.lengths()));
    exactly!(N => a.in_integers::<N>(scale).is(&b.in_integers(scale)))
}

fn holds(object: &FlatObject<'_>, p: DVec3) -> bool {
    let scale = to_integers(object.lengths().chain(p.to_array()));
    exactly!(N => object.in_integers::<N>(scale).holds(&Balls::scaled(p, scale)))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::scene::{PlanePosition, SceneBuilder, Surface};

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
