//! A triangle before a beam.

use glam::DVec3;

use crate::beam::cover::{Cover, Depth, dlen};
use crate::beam::gather::Shaft;
use crate::beam::lens::{HALF, Lens, Linear, MARGIN, Pixels, Tile, pixels_above};

/// A triangle's outline: inside where all of `edges` are positive.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outline {
    /// Of the edges from corner 0 to 1, 1 to 2, 2 to 0.
    pub(crate) edges: [Linear; 3],
    /// Whether corners 0, 1, 2 turn the one way or the other.
    pub(crate) turned: bool,
}

/// A triangle with corners `v`; no outline where it is seen edge-on.
#[inline(always)]
pub(crate) fn cover(v: &[DVec3; 3], lens: &Lens, tile: &Tile) -> (Cover, Option<Outline>) {
    let [a, b, c] = v.map(|v| v - lens.apex);
    let (ab, bc, ca) = (a.cross(b), b.cross(c), c.cross(a));
    let volume = ab.dot(c);
    let reach = a.length() * b.length() * c.length();
    if !(volume.abs() > 1e3 * MARGIN * reach) {
        // Edge-on, or as good as: nothing is known but that it covers nothing.
        let touched = if volume.is_finite() { edge_on(&[a, b, c], lens, tile) } else { Pixels::MAX };
        return (Cover { touched, covered: 0, depth: Depth::Unknown }, None);
    }
    let sign = volume.signum();
    // Corners are rounded in local space.
    let size =
        |m: Linear, x: DVec3, y: DVec3| Linear { size: m.size + x.length() * y.length() * dlen(lens, tile), ..m };
    let edges = [
        size(lens.along(ab, tile).times(sign), a, b),
        size(lens.along(bc, tile).times(sign), b, c),
        size(lens.along(ca, tile).times(sign), c, a),
    ];
    let n = (b - a).cross(c - a);
    let depth = lens.along(n, tile).times(1.0 / n.dot(a));
    let spreads = edges.map(|e| e.spread());
    let (mut touched, mut covered) = (Pixels::MAX, Pixels::MAX);
    for (edge, spread) in edges.iter().zip(spreads) {
        touched &= pixels_above(edge, tile, -spread);
        if touched == 0 {
            return (Cover { touched: 0, covered: 0, depth: Depth::Unknown }, None);
        }
        covered &= pixels_above(edge, tile, spread);
    }
    (Cover { touched, covered, depth: Depth::Flat(depth) }, Some(Outline { edges, turned: sign < 0.0 }))
}

/// Pixels in the rectangle around the projected corners; all where one is not in front.
fn edge_on(v: &[DVec3; 3], lens: &Lens, tile: &Tile) -> Pixels {
    // Coordinates of the point that a direction goes through, by Cramer's rule.
    let Lens { forward: f, right: r, up: u, .. } = *lens;
    let det = f.dot(r.cross(u));
    let (mut lo, mut hi) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
    for p in v {
        let (w, x, y) = (p.dot(r.cross(u)) / det, p.dot(u.cross(f)) / det, p.dot(f.cross(r)) / det);
        if !(w > 1e-9 * (x.abs() / tile.far_x.max(1.0) + y.abs() / tile.far_y.max(1.0))) {
            return Pixels::MAX;
        }
        let at = (x / w, y / w);
        lo = (lo.0.min(at.0), lo.1.min(at.1));
        hi = (hi.0.max(at.0), hi.1.max(at.1));
    }
    let reach = HALF * (1.0 + 1e-3);
    let mut all = 0;
    for j in 0..8 {
        for k in 0..8 {
            let inside = tile.y[j] + reach > lo.1
                && tile.y[j] - reach < hi.1
                && tile.x[k] + reach > lo.0
                && tile.x[k] - reach < hi.0;
            all |= u64::from(inside) << (8 * j + k);
        }
    }
    all
}

/// The plane n · P = h of the triangle with corners `v`, n of length 1.
#[inline(always)]
pub(crate) fn supporting_plane(v: &[DVec3; 3]) -> (DVec3, f64) {
    let n = (v[1] - v[0]).cross(v[2] - v[0]);
    let n = n * (1.0 / n.length());
    (n, n.dot(v[0]))
}

/// A triangle that may stand between a light and a surface.
pub(crate) struct Blocker {
    v: [DVec3; 3],
    /// A normal towards the light.
    n: DVec3,
    /// The corners' greatest distance from the origin.
    size: f64,
    /// What a product with the normal may be below 0 by rounding; negative infinity where the light's side is not
    /// sure.
    slack: f64,
}

impl Blocker {
    /// The triangle with corners `v`, if it reaches into `shaft` and does not have all of `hull` on the side of
    /// `light`.
    #[inline(always)]
    pub(crate) fn new(v: [DVec3; 3], hull: &[DVec3; 8], light: DVec3, shaft: &Shaft) -> Option<Self> {
        let center = (v[0] + v[1] + v[2]) * (1.0 / 3.0);
        let radius = (v[0] - center).length().max((v[1] - center).length()).max((v[2] - center).length());
        if !shaft.meets_ball(center, radius) {
            return None;
        }
        let n = (v[1] - v[0]).cross(v[2] - v[0]);
        let size = v[0].length().max(v[1].length()).max(v[2].length());
        let slack = 1e3 * MARGIN * n.length() * (size + light.length());
        let of_light = n.dot(light - v[0]);
        // Turned so that the light is on its upper side.
        let n = if of_light < 0.0 { -n } else { n };
        let sided = of_light.abs() > slack;
        if sided && hull.iter().all(|p| n.dot(*p - v[0]) >= -slack) {
            return None;
        }
        Some(Self { v, n, size, slack: if sided { slack } else { f64::NEG_INFINITY } })
    }

    /// Whether it is behind a flat surface n · P = h.
    #[inline(always)]
    pub(crate) fn is_behind(&self, (n, h): (DVec3, f64)) -> bool {
        let v = &self.v;
        let most = n.dot(v[0]).max(n.dot(v[1])).max(n.dot(v[2]));
        most <= h + 1e3 * MARGIN * (h.abs() + self.size)
    }

    /// Whether all of the triangle with corners `c` is on the light's side of it.
    #[inline(always)]
    pub(crate) fn is_beyond(&self, c: &[DVec3; 3]) -> bool {
        let Self { v, n, slack, .. } = self;
        let least = n.dot(c[0] - v[0]).min(n.dot(c[1] - v[0])).min(n.dot(c[2] - v[0]));
        *slack >= 0.0 && least >= -slack
    }
}
