//! A plane before a beam.

use super::LocalPlane;
use crate::beam::cover::{Cover, Depth};
use crate::beam::lens::{Lens, MARGIN, Pixels, Tile, pixels_above};

/// What the plane is to a tile under a lens.
#[inline(always)]
pub(crate) fn cover(plane: &LocalPlane, lens: &Lens, tile: &Tile) -> Cover {
    let n = plane.n.to_dvec3();
    let g = plane.h - n.dot(lens.apex);
    let size = plane.h.abs() + lens.apex.length();
    if !(g.abs() > 1e3 * MARGIN * size) {
        // The apex is on the plane, or as good as: the real one never sees it, this one may.
        let touched = if g == 0.0 { 0 } else { Pixels::MAX };
        return Cover { touched, covered: 0, depth: Depth::Unknown };
    }
    let mut w = lens.along(n, tile).times(1.0 / g);
    w.size *= 1.0 + size / g.abs();
    let spread = w.spread();
    Cover { touched: pixels_above(&w, tile, -spread), covered: pixels_above(&w, tile, spread), depth: Depth::Flat(w) }
}
