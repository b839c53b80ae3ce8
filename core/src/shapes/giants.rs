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
    pub(crate) spheres: Vec<(u32, GiantSphere)>,
    /// The same spheres to twice the digits.
    double_spheres: Vec<GiantSphere<DoubleDouble>>,
    pub(crate) triangles: Vec<(u32, GiantTriangle)>,
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
        let mut spheres = Vec::new();
        for (_, id) in candidates {
            match kind(scene, ObjectId(id)) {
                Kind::Sphere(i) if spheres.len() < MOST && kept[usize::from(SPHERES)].contains(&id) => {
                    let giant = GiantSphere::new(&scene.spheres()[i], eye, local.power);
                    spheres.extend(giant.map(|(giant, double)| (id, giant, double)));
                }
                Kind::Triangle(i) if giants.triangles.len() < MOST && kept[usize::from(TRIANGLES)].contains(&id) => {
                    giants
                        .triangles
                        .extend(GiantTriangle::new(&scene.triangles()[i], eye, local.power).map(|t| (id, t)));
                }
                _ => {}
            }
        }
        spheres.sort_unstable_by_key(|(id, ..)| *id);
        giants.spheres = spheres.iter().map(|(id, giant, _)| (*id, *giant)).collect();
        giants.double_spheres = spheres.iter().map(|(.., double)| *double).collect();
        giants.triangles.sort_unstable_by_key(|(id, _)| *id);
        giants
    }

    /// The sphere of this id, if it is a giant.
    pub(crate) fn sphere(&self, id: u32) -> Option<&GiantSphere> {
        let at = self.spheres.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        Some(&self.spheres[at].1)
    }

    /// The sphere of this id to twice the digits, if it is a giant.
    pub(super) fn double_sphere(&self, id: u32) -> Option<&GiantSphere<DoubleDouble>> {
        let at = self.spheres.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        Some(&self.double_spheres[at])
    }

    /// The spheres `ids`, one in each lane, if one of them is a giant; of what is none, nothing is known.
    #[inline(always)]
    pub(crate) fn eight_spheres<S: Simd>(&self, ids: &[u32; 8]) -> Option<GiantSphere<S::F64x8>> {
        let mut lanes = [[f64::NAN; 8]; 5];
        let mut any = false;
        for (k, id) in ids.iter().enumerate() {
            if let Some(s) = self.sphere(*id) {
                (lanes[0][k], lanes[1][k], lanes[2][k], lanes[3][k], lanes[4][k]) = (s.m.x, s.m.y, s.m.z, s.q, s.k);
                any = true;
            }
        }
        let (q, k) = (S::F64x8::load(&lanes[3]), S::F64x8::load(&lanes[4]));
        any.then(|| GiantSphere { m: three::<S>(&lanes, 0), q, k })
    }

    /// The planes of triangles `ids`, as [`Self::eight_spheres`].
    #[inline(always)]
    pub(crate) fn eight_triangles<S: Simd>(&self, ids: &[u32; 8]) -> Option<LocalPlane<S::F64x8>> {
        let mut lanes = [[f64::NAN; 8]; 4];
        let mut any = false;
        for (k, id) in ids.iter().enumerate() {
            if let Some(GiantTriangle { plane: LocalPlane { n, h }, .. }) = self.triangle(*id) {
                (lanes[0][k], lanes[1][k], lanes[2][k], lanes[3][k]) = (n.x, n.y, n.z, *h);
                any = true;
            }
        }
        any.then(|| LocalPlane { n: three::<S>(&lanes, 0), h: S::F64x8::load(&lanes[3]) })
    }

    /// The triangle of this id, if it is a giant.
    pub(crate) fn triangle(&self, id: u32) -> Option<&GiantTriangle> {
        let at = self.triangles.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        Some(&self.triangles[at].1)
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
