//! Which objects of a scene are far larger than what is seen of them: see `shapes::sphere::giant`.

use std::sync::{Mutex, PoisonError};

use crate::bvh::KINDS;
use crate::scene::Scene;
use crate::shapes::sphere::giant::GiantSphere;
use crate::shapes::triangle::giant::GiantTriangle;
use crate::shapes::{Aabb, Kind, Local, ObjectId, SPHERES, TRIANGLES, kind};

/// A giant is so many times farther across than it is from the eye.
const RATIO: f64 = 512.0;
/// It is at least this large in local space: the largest things there are of about 1/4.
const LEAST: f64 = 1.0 / 256.0;
/// So many of each kind are kept at most, for every packet meets them all.
const MOST: usize = 32;
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
    pub(super) fn new(scene: &Scene, local: &Local, candidates: Candidates, kept: &[Vec<u32>; KINDS]) -> Self {
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
            match kind(scene, ObjectId(id)) {
                Kind::Sphere(i) if giants.spheres.len() < MOST && kept[usize::from(SPHERES)].contains(&id) => {
                    giants.spheres.extend(GiantSphere::new(&scene.spheres()[i], eye, local.power).map(|s| (id, s)));
                }
                Kind::Triangle(i) if giants.triangles.len() < MOST && kept[usize::from(TRIANGLES)].contains(&id) => {
                    giants
                        .triangles
                        .extend(GiantTriangle::new(&scene.triangles()[i], eye, local.power).map(|t| (id, t)));
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
