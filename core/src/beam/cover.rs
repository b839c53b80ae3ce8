//! Which pixels of a tile an object touches, which it covers, and how near it is there: what shapes say of themselves.

use super::lens::{HALF, Lens, Linear, MARGIN, Pixels, Tile, row};

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
    /// Of the near side of a sphere: (l + √q) / k; and its radius.
    Ball { l: Linear, q: Quadratic, k: f64, r: f64 },
    /// Anything.
    Unknown,
}

/// A polynomial of degree two over the image plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quadratic {
    /// Of 1, x, y, x², xy, y².
    pub(crate) k: [f64; 6],
    pub(crate) size: f64,
}

impl Quadratic {
    /// l² − k·(d · d).
    pub(crate) fn cone(l: &Linear, k: f64, lens: &Lens, tile: &Tile) -> Self {
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
    pub(crate) fn at(&self, x: f64, y: f64) -> f64 {
        let k = &self.k;
        k[0] + x * (k[1] + k[3] * x + k[4] * y) + y * (k[2] + k[5] * y)
    }

    /// How far it may be from its value at the centre (x, y) of a pixel anywhere in that.
    #[inline(always)]
    pub(crate) fn spread(&self, x: f64, y: f64) -> f64 {
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
            Self::Ball { l, q, k: k2, .. } => {
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

/// A bound on the length of directions.
pub(crate) fn dlen(lens: &Lens, tile: &Tile) -> f64 {
    lens.forward.length() + lens.right.length() * tile.far_x + lens.up.length() * tile.far_y
}
