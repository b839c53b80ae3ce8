//! Which pixels of a tile an object touches, which it covers, and how near it is there.

use glam::DVec3;

use super::lens::{HALF, Lens, Linear, MARGIN, Pixels, Tile, greater, pixels_above, row};
use crate::shapes::plane::LocalPlane;
use crate::shapes::sphere::LocalSphere;

/// Something that passes some pixels of a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    /// The edge where this is 0.
    Edge(Linear),
    /// A ball's outline: its middle and two conjugate radii, in plane units.
    Oval([f64; 2], [f64; 2], [f64; 2]),
}

/// What an object is to a tile under a lens. Inverse distances w = 1/t are in units of the direction's length.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cover {
    /// Pixels in which it may be met.
    pub(crate) touched: Pixels,
    /// Pixels in all points of which it is met.
    pub(crate) covered: Pixels,
    pub(crate) depth: Depth,
}

/// How the inverse distance varies.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Depth {
    /// Of a flat object.
    Flat(Linear),
    /// Of the near side of a sphere: (l + √q) / k.
    Ball { l: Linear, q: Quadratic, k: f64 },
    /// Anything.
    Unknown,
}

/// A polynomial of degree two over the image plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quadratic {
    /// Of 1, x, y, x², xy, y².
    pub(crate) k: [f64; 6],
    size: f64,
}

impl Quadratic {
    /// l² − k·(d · d).
    fn cone(l: &Linear, k: f64, lens: &Lens, tile: &Tile) -> Self {
        let Lens { forward: f, right: r, up: u, .. } = lens;
        let far = f.length() + r.length() * tile.far_x + u.length() * tile.far_y;
        Self {
            k: [
                l.a * l.a - k * f.dot(*f),
                2.0 * (l.a * l.b - k * f.dot(*r)),
                2.0 * (l.a * l.c - k * f.dot(*u)),
                l.b * l.b - k * r.dot(*r),
                2.0 * (l.b * l.c - k * r.dot(*u)),
                l.c * l.c - k * u.dot(*u),
            ],
            size: l.size * l.size + k.abs() * far * far,
        }
    }

    #[inline(always)]
    fn at(&self, x: f64, y: f64) -> f64 {
        let k = &self.k;
        k[0] + x * (k[1] + k[3] * x + k[4] * y) + y * (k[2] + k[5] * y)
    }

    /// How far it may be from its value at the centre (x, y) of a pixel anywhere in that.
    #[inline(always)]
    fn spread(&self, x: f64, y: f64) -> f64 {
        let k = &self.k;
        let slope = (k[1] + 2.0 * k[3] * x + k[4] * y).abs() + (k[2] + k[4] * x + 2.0 * k[5] * y).abs();
        slope * HALF + (k[3].abs() + k[4].abs() + k[5].abs()) * HALF * HALF + MARGIN * self.size
    }
}

impl Depth {
    /// The outline of a ball that is seen as an ellipse.
    pub(crate) fn outline(&self) -> Option<Shape> {
        let Self::Ball { q, .. } = self else { return None };
        let [k0, k1, k2, k3, k4, k5] = q.k;
        // Its matrix is negative where the outline is an ellipse.
        let det = k3 * k5 - 0.25 * k4 * k4;
        if !(k3 < 0.0 && det > 0.0) {
            return None;
        }
        let middle = [(0.25 * k4 * k2 - 0.5 * k5 * k1) / det, (0.25 * k4 * k1 - 0.5 * k3 * k2) / det];
        let top = k0 + 0.5 * (k1 * middle[0] + k2 * middle[1]);
        if !(top > 0.0) {
            return None;
        }
        // Conjugate radii by Cholesky: of -k3 x² - k4 xy - k5 y² = top.
        let a = (-k3).sqrt();
        let b = -0.5 * k4 / a;
        let c = (det / -k3).sqrt();
        let r = top.sqrt();
        Some(Shape::Oval(middle, [r / a, 0.0], [-b * r / (a * c), r / c]))
    }

    /// Least and greatest inverse distance in the pixels of row `j`.
    #[inline(always)]
    pub(crate) fn row(&self, tile: &Tile, j: usize) -> ([f64; 8], [f64; 8]) {
        let (mut lo, mut hi) = ([0.0; 8], [f64::INFINITY; 8]);
        match self {
            Self::Flat(w) => {
                let (values, spread) = (row(w, tile, j), w.spread());
                for k in 0..8 {
                    (lo[k], hi[k]) = (values[k] - spread, values[k] + spread);
                }
            }
            Self::Ball { l, q, k: k2 } => {
                let (values, spread) = (row(l, tile, j), l.spread());
                for k in 0..8 {
                    let (root, s) = (q.at(tile.x[k], tile.y[j]), q.spread(tile.x[k], tile.y[j]));
                    lo[k] = (values[k] - spread + (root - s).max(0.0).sqrt()) / k2 * (1.0 - MARGIN);
                    hi[k] = (values[k] + spread + (root + s).max(0.0).sqrt()) / k2 * (1.0 + MARGIN);
                }
            }
            Self::Unknown => {}
        }
        (lo, hi)
    }
}

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
pub(crate) fn triangle(v: &[DVec3; 3], lens: &Lens, tile: &Tile) -> (Cover, Option<Outline>) {
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

/// A bound on the length of directions.
fn dlen(lens: &Lens, tile: &Tile) -> f64 {
    lens.forward.length() + lens.right.length() * tile.far_x + lens.up.length() * tile.far_y
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

/// A plane.
#[inline(always)]
pub(crate) fn plane(plane: &LocalPlane, lens: &Lens, tile: &Tile) -> Cover {
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

/// A sphere.
#[inline(always)]
pub(crate) fn sphere(s: &LocalSphere, lens: &Lens, tile: &Tile) -> Cover {
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
    Cover { touched, covered, depth: Depth::Ball { l, q, k } }
}
