//! What objects are to beams.

use glam::DVec3;

use super::plane::LocalPlane;
use super::sphere::LocalSphere;
use super::triangle::beam::Outline;
use super::{Listed, Local, ObjectId, Shape, of_shape, plane, sphere, triangle};
use crate::beam::cover::{Cover, Depth};
use crate::beam::gather::Shaft;
use crate::beam::lens::{Lens, Pixels, Tile};
use crate::scene::Scene;

/// What an object is to beams. They need not know a shape: where it is [`Figure::Unknown`], nothing is proven, which
/// costs samples alone.
pub(crate) enum Figure {
    Plane(LocalPlane),
    Ball(LocalSphere),
    /// By its corners.
    Triangle([DVec3; 3]),
    Unknown,
}

impl Figure {
    #[inline(always)]
    pub(crate) fn of(scene: &Scene, local: &Local, id: ObjectId) -> Self {
        of_shape!(scene, id, O, i => O::all(scene)[i].figure(i, local))
    }

    /// The plane n · P = h that it lies in, n of length 1, if it is flat.
    #[inline(always)]
    pub(crate) fn supporting_plane(&self) -> Option<(DVec3, f64)> {
        match self {
            Self::Plane(p) => Some((p.n.to_dvec3(), p.h)),
            Self::Triangle(corners) => Some(triangle::beam::supporting_plane(corners)),
            Self::Ball(_) | Self::Unknown => None,
        }
    }

    /// A triangle's corners.
    #[inline(always)]
    pub(crate) fn corners(&self) -> Option<[DVec3; 3]> {
        if let Self::Triangle(corners) = self { Some(*corners) } else { None }
    }

    /// What it is to a tile under a lens; and the corners and the outline of a triangle that is not seen edge-on.
    #[inline(always)]
    pub(crate) fn cover(&self, lens: &Lens, tile: &Tile) -> (Cover, Option<([DVec3; 3], Outline)>) {
        match self {
            Self::Plane(plane) => (plane::beam::cover(plane, lens, tile), None),
            Self::Ball(ball) => (sphere::beam::cover(ball, lens, tile), None),
            Self::Triangle(corners) => {
                let (cover, outline) = triangle::beam::cover(corners, lens, tile);
                (cover, outline.map(|o| (*corners, o)))
            }
            Self::Unknown => (Cover { touched: Pixels::MAX, covered: 0, depth: Depth::Unknown }, None),
        }
    }

    /// What it is where it may stand between `light` and points of the hull; none where it surely does not, and of
    /// planes.
    #[inline(always)]
    pub(crate) fn blocker(&self, hull: &[DVec3; 8], light: DVec3, shaft: &Shaft) -> Option<Blocker> {
        match self {
            Self::Plane(_) => None,
            Self::Ball(ball) => sphere::beam::Blocker::new(ball, shaft).map(Blocker::Ball),
            Self::Triangle(v) => triangle::beam::Blocker::new(*v, hull, light, shaft).map(Blocker::Triangle),
            Self::Unknown => Some(Blocker::Unknown),
        }
    }
}

/// A bounded object that may stand between a light and surfaces.
pub(crate) enum Blocker {
    Ball(sphere::beam::Blocker),
    Triangle(triangle::beam::Blocker),
    Unknown,
}

impl Blocker {
    /// Whether it is behind a flat surface n · P = h, or has all of a triangle with these corners on the light's side.
    #[inline(always)]
    pub(crate) fn is_harmless(&self, flat: Option<(DVec3, f64)>, corners: Option<&[DVec3; 3]>) -> bool {
        match self {
            Self::Ball(body) => flat.is_some_and(|flat| body.is_behind(flat)),
            Self::Triangle(body) => {
                flat.is_some_and(|flat| body.is_behind(flat)) || corners.is_some_and(|c| body.is_beyond(c))
            }
            Self::Unknown => false,
        }
    }
}
