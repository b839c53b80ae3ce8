//! Apexes, directions that are linear in the image plane, and tiles of it.

use glam::DVec3;

use crate::film::UNIT;

/// Pixels along a tile's edge.
pub(crate) const EDGE: u32 = 8;
/// Relative margin of every comparison: thousands of roundings of f64.
pub(crate) const MARGIN: f64 = 1e-12;

/// a + b·x + c·y over the image plane, in plane units, and the size of what was added up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linear {
    pub(crate) a: f64,
    pub(crate) b: f64,
    pub(crate) c: f64,
    /// Rounding of a value is below this, once multiplied by [`MARGIN`].
    pub(crate) size: f64,
}

impl Linear {
    /// Times a number.
    pub(crate) fn times(self, k: f64) -> Self {
        Self { a: self.a * k, b: self.b * k, c: self.c * k, size: self.size * k.abs() }
    }

    /// How far it may be from its value at a pixel's centre anywhere in the pixel.
    #[inline(always)]
    pub(crate) fn spread(&self) -> f64 {
        (self.b.abs() + self.c.abs()) * HALF + MARGIN * self.size
    }
}

/// Half a pixel's edge.
pub(crate) const HALF: f64 = UNIT as f64 / 2.0;

/// Points seen from `apex` along directions forward + x · right + y · up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens {
    pub(crate) apex: DVec3,
    pub(crate) forward: DVec3,
    pub(crate) right: DVec3,
    pub(crate) up: DVec3,
}

impl Lens {
    pub(crate) fn direction(&self, x: f64, y: f64) -> DVec3 {
        self.forward + self.right * x + self.up * y
    }

    /// n · direction, over `tile`.
    #[inline(always)]
    pub(crate) fn along(&self, n: DVec3, tile: &Tile) -> Linear {
        let (a, b, c) = (n.dot(self.forward), n.dot(self.right), n.dot(self.up));
        let size = n.abs().dot(self.forward.abs())
            + n.abs().dot(self.right.abs()) * tile.far_x
            + n.abs().dot(self.up.abs()) * tile.far_y;
        Linear { a, b, c, size }
    }

    /// What is seen in the mirror n · P = h, n of length 1.
    pub(crate) fn mirrored(&self, n: DVec3, h: f64) -> Self {
        let turn = |v: DVec3| v - n * (2.0 * n.dot(v));
        Self {
            apex: self.apex + n * (2.0 * (h - n.dot(self.apex))),
            forward: turn(self.forward),
            right: turn(self.right),
            up: turn(self.up),
        }
    }

    /// The points of the plane n · P = h that this lens sees, as seen from `light`; the inverse distance of the
    /// plane itself is then |n · direction| of this lens.
    pub(crate) fn lit_from(&self, light: DVec3, n: DVec3, h: f64) -> Self {
        let g = h - n.dot(self.apex);
        let to = self.apex - light;
        let turn = |v: DVec3| (to * n.dot(v) + v * g) * g.signum();
        Self { apex: light, forward: turn(self.forward), right: turn(self.right), up: turn(self.up) }
    }
}

/// A square of [`EDGE`] × [`EDGE`] pixels of the image plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tile {
    /// Centres of the columns, and of the rows from the top.
    pub(crate) x: [f64; 8],
    pub(crate) y: [f64; 8],
    /// Greatest magnitudes of coordinates.
    pub(crate) far_x: f64,
    pub(crate) far_y: f64,
}

impl Tile {
    /// The tile whose upper left pixel has its centre at (x, y), in plane units.
    pub(crate) fn new(x: i32, y: i32) -> Self {
        let unit = f64::from(UNIT);
        let (x0, y0) = (f64::from(x), f64::from(y));
        let column = |k: usize| x0 + unit * k as f64;
        let row = |k: usize| y0 - unit * k as f64;
        let far = |a: f64, b: f64| a.abs().max(b.abs()) + unit;
        Self {
            x: std::array::from_fn(column),
            y: std::array::from_fn(row),
            far_x: far(column(0), column(7)),
            far_y: far(row(0), row(7)),
        }
    }

    /// The corners, clockwise from the upper left.
    pub(crate) fn corners(&self) -> [(f64, f64); 4] {
        let (l, r, t, b) = (self.x[0] - HALF, self.x[7] + HALF, self.y[0] + HALF, self.y[7] - HALF);
        [(l, t), (r, t), (r, b), (l, b)]
    }
}

/// A set of a tile's pixels, bit 8·row + column.
pub(crate) type Pixels = u64;

/// Lanes above `limit`.
#[inline(always)]
pub(crate) fn above(values: &[f64; 8], limit: f64) -> u8 {
    let mut bytes = [0u8; 8];
    for k in 0..8 {
        bytes[k] = u8::from(values[k] > limit);
    }
    gather_bits(bytes)
}

/// Lanes in which a is above b.
#[inline(always)]
pub(crate) fn greater(a: &[f64; 8], b: &[f64; 8]) -> u8 {
    let mut bytes = [0u8; 8];
    for k in 0..8 {
        bytes[k] = u8::from(a[k] > b[k]);
    }
    gather_bits(bytes)
}

/// Bit k is the k-th byte, each 0 or 1.
#[inline(always)]
fn gather_bits(bytes: [u8; 8]) -> u8 {
    (u64::from_le_bytes(bytes).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// Pixels at whose centres `f` is above `limit`.
#[inline(always)]
pub(crate) fn pixels_above(f: &Linear, tile: &Tile, limit: f64) -> Pixels {
    let mut all = 0;
    for j in 0..8 {
        all |= u64::from(above(&row(f, tile, j), limit)) << (8 * j);
    }
    all
}

/// Values of a linear function at the centres of row `j`.
#[inline(always)]
pub(crate) fn row(f: &Linear, tile: &Tile, j: usize) -> [f64; 8] {
    let start = f.a + f.c * tile.y[j];
    let mut values = [0.0; 8];
    for k in 0..8 {
        values[k] = start + f.b * tile.x[k];
    }
    values
}
