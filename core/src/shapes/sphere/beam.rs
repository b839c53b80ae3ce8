//! A sphere before a beam.

use glam::DVec3;

use super::LocalSphere;
use crate::beam::cover::{Cover, Depth, Quadratic, dlen};
use crate::beam::gather::Shaft;
use crate::beam::lens::{Lens, MARGIN, Pixels, Tile, greater, row};

/// What the sphere is to a tile under a lens.
#[inline(always)]
pub(crate) fn cover(s: &LocalSphere, lens: &Lens, tile: &Tile) -> Cover {
    let c = s.center() - lens.apex;
    let k = c.dot(c) - s.r * s.r;
    let size = c.dot(c) + s.r * s.r;
    let everywhere = Cover { touched: Pixels::MAX, covered: 0, depth: Depth::Unknown };
    if !(k.abs() > 1e3 * MARGIN * size) {
        return everywhere;
    }
    if k < 0.0 {
        return Cover { covered: Pixels::MAX, ..everywhere };
    }
    let mut l = lens.along(c, tile);
    l.size += (c.length() + s.center().length()) * dlen(lens, tile);
    let mut q = Quadratic::cone(&l, k, lens, tile);
    q.size += size * dlen(lens, tile) * dlen(lens, tile);
    let spread = l.spread();
    let (mut touched, mut covered) = (0, 0);
    for j in 0..8 {
        let front = row(&l, tile, j);
        let (mut most, mut least) = ([0.0; 8], [0.0; 8]);
        for i in 0..8 {
            let (value, s) = (q.at(tile.x[i], tile.y[j]), q.spread(tile.x[i], tile.y[j]));
            (most[i], least[i]) = (value + s, value - s);
        }
        let zero = [0.0; 8];
        let (mut near, mut far) = ([0.0; 8], [0.0; 8]);
        for i in 0..8 {
            (near[i], far[i]) = (front[i] - spread, front[i] + spread);
        }
        touched |= u64::from(greater(&most, &zero) & greater(&far, &zero)) << (8 * j);
        covered |= u64::from(greater(&least, &zero) & greater(&near, &zero)) << (8 * j);
    }
    Cover { touched, covered, depth: Depth::Ball { l, q, k, r: s.r } }
}

/// A ball that may stand between a light and a surface.
pub(crate) struct Blocker {
    c: DVec3,
    r: f64,
}

impl Blocker {
    /// The sphere, if it reaches into `shaft`.
    #[inline(always)]
    pub(crate) fn new(s: &LocalSphere, shaft: &Shaft) -> Option<Self> {
        let (c, r) = (s.center(), s.r);
        shaft.meets_ball(c, r).then_some(Self { c, r })
    }

    /// Whether it is behind a flat surface n · P = h.
    #[inline(always)]
    pub(crate) fn is_behind(&self, (n, h): (DVec3, f64)) -> bool {
        let Self { c, r } = self;
        n.dot(*c) + r <= h + 1e3 * MARGIN * (h.abs() + c.length() + r)
    }
}
