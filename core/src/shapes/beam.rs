//! What objects are to beams.

use glam::DVec3;

use super::triangle::beam::Outline;
use super::{Kind, Local, ObjectId, kind, plane, sphere, triangle};
use crate::beam::cover::Cover;
use crate::beam::gather::Shaft;
use crate::beam::lens::{Lens, Tile};
use crate::scene::Scene;

/// What object `id` is to a tile under a lens.
#[inline(always)]
pub(crate) fn cover(
    scene: &Scene,
    local: &Local,
    id: ObjectId,
    lens: &Lens,
    tile: &Tile,
) -> (Cover, Option<([DVec3; 3], Outline)>) {
    match kind(scene, id) {
        Kind::Plane(i) => (plane::beam::cover(&local.planes[i], lens, tile), None),
        Kind::Sphere(i) => (sphere::beam::cover(&local.spheres[i], lens, tile), None),
        Kind::Triangle(i) => {
            let v = local.triangle(&scene.triangles()[i]).corners();
            let (cover, outline) = triangle::beam::cover(&v, lens, tile);
            (cover, outline.map(|o| (v, o)))
        }
    }
}

/// The plane n · P = h that a flat object lies in, n of length 1; none of a sphere.
#[inline(always)]
pub(crate) fn supporting_plane(scene: &Scene, local: &Local, id: ObjectId) -> Option<(DVec3, f64)> {
    match kind(scene, id) {
        Kind::Sphere(_) => None,
        Kind::Plane(i) => Some((local.planes[i].n.to_dvec3(), local.planes[i].h)),
        Kind::Triangle(i) => Some(triangle::beam::supporting_plane(&local.triangle(&scene.triangles()[i]).corners())),
    }
}

/// A triangle's corners.
#[inline(always)]
pub(crate) fn corners(scene: &Scene, local: &Local, id: ObjectId) -> Option<[DVec3; 3]> {
    match kind(scene, id) {
        Kind::Triangle(i) => Some(local.triangle(&scene.triangles()[i]).corners()),
        _ => None,
    }
}

/// A bounded object that may stand between a light and surfaces.
pub(crate) enum Blocker {
    Sphere(sphere::beam::Blocker),
    Triangle(triangle::beam::Blocker),
}

impl Blocker {
    /// Object `id` as what may stand between `light` and points of the hull; none where it surely does not.
    #[inline(always)]
    pub(crate) fn new(
        scene: &Scene,
        local: &Local,
        id: ObjectId,
        hull: &[DVec3; 8],
        light: DVec3,
        shaft: &Shaft,
    ) -> Option<Self> {
        match kind(scene, id) {
            Kind::Plane(_) => None,
            Kind::Sphere(i) => sphere::beam::Blocker::new(&local.spheres[i], shaft).map(Self::Sphere),
            Kind::Triangle(i) => {
                let v = local.triangle(&scene.triangles()[i]).corners();
                triangle::beam::Blocker::new(v, hull, light, shaft).map(Self::Triangle)
            }
        }
    }

    /// Whether it is behind a flat surface n · P = h, or has all of a triangle with these corners on the light's side.
    #[inline(always)]
    pub(crate) fn is_harmless(&self, flat: Option<(DVec3, f64)>, corners: Option<&[DVec3; 3]>) -> bool {
        match self {
            Self::Sphere(body) => flat.is_some_and(|flat| body.is_behind(flat)),
            Self::Triangle(body) => {
                flat.is_some_and(|flat| body.is_behind(flat)) || corners.is_some_and(|c| body.is_beyond(c))
            }
        }
    }
}
