//! The points that adaptive sampling can look through.

use glam::DVec3;

use crate::film::Region;
use crate::geometry::real::V3;
use crate::trace::{PlanePoint, Tracer};

/// Points along a pixel's edge; a power of two, so that halves of halves are points too.
pub(crate) const UNIT: i32 = 4096;
/// The [`crate::trace::PlanePoint`] grid of adaptive sampling: its unit is half a cell.
pub(crate) const GRID: u32 = UNIT as u32 / 2;

/// Root mean square of a colour's components.
pub(crate) fn rms(d: DVec3) -> f64 {
    (d.dot(d) / 3.0).sqrt()
}

/// How far values reach from the least to the greatest of each component.
pub(crate) fn extent(values: impl Iterator<Item = DVec3>) -> f64 {
    let (lo, hi) = values.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    rms(hi - lo)
}

pub(crate) fn vector(v: V3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

/// The plane point of a region's upper left corner.
pub(crate) fn plane_origin(tracer: &Tracer, region: Region) -> PlanePoint {
    let view = &tracer.settings().view;
    let g = GRID as i32;
    PlanePoint {
        x: UNIT * region.x0 as i32 - g * view.width() as i32,
        y: g * view.height() as i32 - UNIT * region.y0 as i32,
    }
}

impl Tracer {
    /// Where a direction of local space meets the image plane, in plane units, if it does.
    pub(crate) fn project(&self, d: DVec3) -> Option<(f64, f64)> {
        let f = self.frame();
        let depth = d.dot(f.forward) / f.forward.dot(f.forward);
        (depth > 0.0).then(|| (d.dot(f.right) / f.right.dot(f.right) / depth, d.dot(f.up) / f.up.dot(f.up) / depth))
    }
}
