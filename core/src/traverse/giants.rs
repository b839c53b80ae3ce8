//! Which objects of a scene are far larger than what is seen of them: see `shapes::sphere::giant`.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use crate::numeric::{Big, V3, Vector};
use crate::scene::Scene;
use crate::shapes::plane::LocalPlane;
use crate::shapes::sphere::giant::GiantSphere;
use crate::shapes::triangle::giant::GiantTriangle;
use crate::shapes::{Aabb, Kind, Local, ObjectId, kind};

/// A giant is so many times farther across than it is from the eye.
const RATIO: f64 = 512.0;
/// It is at least this large in local space: the largest things there are of about 1/4.
const LEAST: f64 = 1.0 / 256.0;
/// So many of each kind are kept at most, for every packet meets them all.
const MOST: usize = 32;
/// Limbs in which they are found.
const WIDE: usize = 24;
/// What is this many bits below its terms may be nothing.
const LOST: i64 = 1000;

/// The giants of a scene, by rising id.
#[derive(Debug, Default)]
pub(crate) struct Giants {
    pub(crate) spheres: Vec<(u32, GiantSphere)>,
    pub(crate) triangles: Vec<(u32, GiantTriangle)>,
}

/// Objects that may be giants, by the boxes of all.
#[derive(Debug, Default)]
pub(super) struct Candidates(Mutex<Vec<(f64, u32)>>);

impl Candidates {
    /// Looks at the box of object `id`.
    pub(super) fn see(&self, id: u32, b: &Aabb) {
        let across = (b.hi - b.lo).max_element();
        if across < LEAST {
            return;
        }
        // How far the eye is outside the box.
        let away = b.lo.max(-b.hi).max_element().max(0.0);
        if across > RATIO * away {
            let mut found = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            found.push((across / away, id));
        }
    }
}

impl Giants {
    /// The giants among `candidates` whose ids are among `kept`.
    pub(super) fn new(scene: &Scene, local: &Local, candidates: Candidates, kept: &[Vec<u32>; 2]) -> Self {
        let mut candidates = candidates.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut giants = Self::default();
        if candidates.is_empty() {
            return giants;
        }
        // The largest beside their distance; ids make the order one.
        candidates.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        candidates.truncate(4 * MOST);
        for (_, id) in candidates {
            match kind(scene, ObjectId(id)) {
                Kind::Sphere(i) if giants.spheres.len() < MOST && kept[1].contains(&id) => {
                    giants.spheres.extend(sphere(scene, local, i).map(|s| (id, s)));
                }
                Kind::Triangle(i) if giants.triangles.len() < MOST && kept[0].contains(&id) => {
                    giants.triangles.extend(triangle(scene, local, i).map(|t| (id, t)));
                }
                _ => {}
            }
        }
        giants.spheres.sort_unstable_by_key(|(id, _)| *id);
        giants.triangles.sort_unstable_by_key(|(id, _)| *id);
        giants
    }

    /// The sphere of this id, if it is a giant.
    pub(crate) fn sphere(&self, id: u32) -> Option<&GiantSphere> {
        let at = self.spheres.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        Some(&self.spheres[at].1)
    }

    /// The triangle of this id, if it is a giant.
    pub(crate) fn triangle(&self, id: u32) -> Option<&GiantTriangle> {
        let at = self.triangles.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        Some(&self.triangles[at].1)
    }
}

/// `x` to the nearest f64, `None` where its digits may be lost beside `terms` or it is beyond f64's normal numbers.
fn known(x: &Big<WIDE>, terms: i64) -> Option<f64> {
    if x.is_zero() || x.exponent() < terms - LOST {
        return None;
    }
    let rounded = x.to_f64();
    (rounded.is_finite() && rounded.abs() > 1e-200).then_some(rounded)
}

/// The components of `v`, of which those next to nothing become 0.
fn vector(v: &Vector<WIDE>) -> V3<f64> {
    let all = v.to_f64();
    let least = 1e-250 * all.abs().max_element();
    V3::splat(DVec3::from_array(all.to_array().map(|x| if x.abs() < least { 0.0 } else { x })))
}

fn sphere(scene: &Scene, local: &Local, i: usize) -> Option<GiantSphere> {
    let (s, eye) = (&scene.spheres()[i], Vector::<WIDE>::new(scene.camera().location()));
    let (c, r) = (Vector::<WIDE>::new(s.center) - eye, Big::<WIDE>::new(s.radius));
    let (cc, rr, power) = (c.dot(&c), r * r, i64::from(local.power));
    let twice = r.scale(1);
    let k = (cc - rr).over(twice);
    // The eye is as near as a giant's has to be.
    let near = known(&k, rr.exponent() - r.exponent())?;
    if k.exponent() > r.exponent() - 9 {
        return None;
    }
    let q = known(&twice.reciprocal().scale(power), i64::MIN + LOST)?;
    let k = known(&k.scale(-power), i64::MIN + LOST)?;
    (near != 0.0).then(|| GiantSphere { m: vector(&-(c * r.reciprocal())), q, k })
}

fn triangle(scene: &Scene, local: &Local, i: usize) -> Option<GiantTriangle> {
    let t = &scene.triangles()[i];
    let [a, b, c] = t.written.map(Vector::<WIDE>::new);
    let (e1, e2) = if t.by_sides() { (b, c) } else { (b - a, c - a) };
    let a = a - Vector::new(scene.camera().location());
    let (n, power) = (e1.cross(&e2), i64::from(local.power));
    let nn = n.dot(&n);
    let terms = e1.exponent() + e2.exponent();
    if nn.is_zero() || n.exponent() < terms - LOST {
        return None;
    }
    let unit = n * nn.sqrt().reciprocal();
    let h = unit.dot(&a);
    let h = known(&h, a.exponent()).and_then(|_| known(&h.scale(-power), i64::MIN + LOST))?;
    let (u, v) = (e2.cross(&n) * nn.reciprocal(), n.cross(&e1) * nn.reciprocal());
    // Next to nothing is nothing beside a weight of 1.
    let weight = |u: &Vector<WIDE>| known(&-u.dot(&a), u.exponent() + a.exponent()).unwrap_or(0.0);
    let (u0, v0) = (weight(&u), weight(&v));
    let (u, v) = (vector(&u.scale(power)), vector(&v.scale(power)));
    let sound = u.norm1() + v.norm1() < 1e100 && u0.abs() + v0.abs() < 1e100;
    sound.then(|| GiantTriangle { plane: LocalPlane { n: vector(&unit), h }, u, u0, v, v0 })
}
