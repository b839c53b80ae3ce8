//! Which objects of a scene are far larger than what is seen of them: see [`super::sphere::giant`]. They are described
//! around the eye, found in wide numbers, and rounded once.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use super::plane::LocalPlane;
use super::sphere::giant::GiantSphere;
use super::triangle::giant::GiantTriangle;
use super::{Aabb, Kind, Local, ObjectId, SPHERES, TRIANGLES, kind};
use crate::bvh::KINDS;
use crate::numeric::{Big, DoubleDouble, V3, Vector};
use crate::scene::Scene;
use crate::simd::{F64x8, Simd, three};

/// A giant is so many times farther across than it is from the eye.
const RATIO: f64 = 512.0;
/// It is at least this large in local space, where the largest things are of about 1/4: a planet beside its sun is.
const LEAST: f64 = 1.0 / (1u64 << 40) as f64;
/// So many of each kind are kept at most, for every packet meets them all.
const MOST: usize = 32;
/// Limbs in which they are found.
pub(super) const WIDE: usize = 24;
/// What is this many bits below its terms may be nothing.
pub(super) const LOST: i64 = 1000;

/// The giants of a scene, by rising id.
#[derive(Debug, Default)]
pub(crate) struct Giants {
    /// And the same to twice the digits.
    pub(crate) spheres: Vec<(ObjectId, (GiantSphere, GiantSphere<DoubleDouble>))>,
    pub(crate) triangles: Vec<(ObjectId, GiantTriangle)>,
}

/// What is listed by this id.
fn find<T>(list: &[(ObjectId, T)], id: ObjectId) -> Option<&T> {
    let at = list.binary_search_by_key(&id, |(id, _)| *id).ok()?;
    Some(&list[at].1)
}

/// The `numbers` of what is listed by `ids`, one in each lane, if one is; of what is not, nothing is known.
#[inline(always)]
fn eight<T, const N: usize>(
    list: &[(ObjectId, T)],
    ids: &[u32; 8],
    numbers: fn(&T) -> [f64; N],
) -> Option<[[f64; 8]; N]> {
    if list.is_empty() {
        return None;
    }
    let mut lanes = [[f64::NAN; 8]; N];
    let mut any = false;
    for (k, id) in ids.iter().enumerate() {
        if let Some(found) = find(list, ObjectId(*id)) {
            for (lanes, x) in lanes.iter_mut().zip(numbers(found)) {
                lanes[k] = x;
            }
            any = true;
        }
    }
    any.then_some(lanes)
}

/// Objects that may be giants, by the boxes of all.
#[derive(Debug, Default)]
pub(crate) struct Candidates(Mutex<Vec<(f64, u32)>>);

impl Candidates {
    /// Looks at the box of object `id`.
    pub(crate) fn see(&self, id: u32, b: &Aabb) {
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
    pub(crate) fn new(scene: &Scene, local: &Local, candidates: Candidates, kept: &[Vec<u32>; KINDS]) -> Self {
        let mut candidates = candidates.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut giants = Self::default();
        if candidates.is_empty() {
            return giants;
        }
        // The largest beside their distance; ids make the order one.
        candidates.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        candidates.truncate(4 * MOST);
        let eye = scene.camera().location();
        for (_, id) in candidates {
            let id = ObjectId(id);
            match kind(scene, id) {
                Kind::Sphere(i) if giants.spheres.len() < MOST && kept[usize::from(SPHERES)].contains(&id.0) => {
                    giants.spheres.extend(GiantSphere::new(&scene.spheres()[i], eye, local.power).map(|s| (id, s)));
                }
                Kind::Triangle(i) if giants.triangles.len() < MOST && kept[usize::from(TRIANGLES)].contains(&id.0) => {
                    let triangle = &scene.triangles()[i];
                    giants.triangles.extend(GiantTriangle::new(triangle, eye, local.power).map(|t| (id, t)));
                }
                _ => {}
            }
        }
        giants.spheres.sort_unstable_by_key(|(id, _)| *id);
        giants.triangles.sort_unstable_by_key(|(id, _)| *id);
        giants
    }

    /// The sphere of this id, if it is a giant; and the same to twice the digits.
    pub(crate) fn sphere(&self, id: ObjectId) -> Option<&(GiantSphere, GiantSphere<DoubleDouble>)> {
        find(&self.spheres, id)
    }

    /// The triangle of this id, if it is a giant.
    pub(crate) fn triangle(&self, id: ObjectId) -> Option<&GiantTriangle> {
        find(&self.triangles, id)
    }

    /// The spheres `ids`, one in each lane, if one of them is a giant; of what is none, nothing is known.
    #[inline(always)]
    pub(crate) fn eight_spheres<S: Simd>(&self, ids: &[u32; 8]) -> Option<GiantSphere<S::F64x8>> {
        let lanes = eight(&self.spheres, ids, |(s, _)| [s.m.x, s.m.y, s.m.z, s.q, s.k])?;
        Some(GiantSphere { m: three::<S>(&lanes, 0), q: S::F64x8::load(&lanes[3]), k: S::F64x8::load(&lanes[4]) })
    }

    /// The planes of triangles `ids`, as [`Self::eight_spheres`].
    #[inline(always)]
    pub(crate) fn eight_triangles<S: Simd>(&self, ids: &[u32; 8]) -> Option<LocalPlane<S::F64x8>> {
        let lanes = eight(&self.triangles, ids, |t| [t.plane.n.x, t.plane.n.y, t.plane.n.z, t.plane.h])?;
        Some(LocalPlane { n: three::<S>(&lanes, 0), h: S::F64x8::load(&lanes[3]) })
    }
}

/// `x` to the nearest f64, `None` where its digits may be lost beside `terms` or it is beyond f64's normal numbers.
pub(super) fn known(x: &Big<WIDE>, terms: i64) -> Option<f64> {
    if x.is_zero() || x.exponent() < terms - LOST {
        return None;
    }
    let rounded = x.to_f64();
    (rounded.is_finite() && rounded.abs() > 1e-200).then_some(rounded)
}

/// The components of `v`, of which those next to nothing become 0.
pub(super) fn vector(v: &Vector<WIDE>) -> V3<f64> {
    let all = v.to_f64();
    let least = 1e-250 * all.abs().max_element();
    V3::splat(DVec3::from_array(all.to_array().map(|x| if x.abs() < least { 0.0 } else { x })))
}
