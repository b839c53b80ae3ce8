//! Points spread over a pixel so evenly that any few of them are, and the error of their mean.

use glam::DVec3;

use crate::trace::mix;

/// The most points of a pixel, as a power of two.
pub(crate) const MOST: u32 = 10;
/// Bits of a coordinate.
const BITS: u32 = 10;
/// The variance of a mean over a net per pair of neighbours that differ, and their difference's
/// square. An edge passes 1.27 such pairs a cell's width, and as many cells; in each, its share
/// of the area has a variance of 1/6 at most about what one point shows.
const PAIR: f64 = 1.0 / 6.0;

/// The k-th point of pixel (x, y) in 1/1024 pixel: the two-dimensional Sobol sequence, whose
/// every run of 2^m points from a multiple of 2^m on has one point in each of the 2^m cells of
/// any grid of 2^a × 2^(m − a); turned by a digital shift of the pixel's own.
pub(crate) fn point(k: u32, pixel: (u32, u32)) -> (u32, u32) {
    let x = k.reverse_bits() >> (32 - BITS);
    let (mut y, mut column, mut bits) = (0, 1u32 << 31, k);
    while bits != 0 {
        if bits & 1 == 1 {
            y ^= column;
        }
        column ^= column >> 1;
        bits >>= 1;
    }
    let (sx, sy) = shift(pixel);
    (x ^ sx, (y >> (32 - BITS)) ^ sy)
}

/// Which of 4 × 4 cells of a pixel its k-th point is in, quarter by quarter.
pub(crate) fn cell(k: u32, pixel: (u32, u32)) -> u32 {
    let (x, y) = point(k, pixel);
    let (x, y) = (x >> (BITS - 2), y >> (BITS - 2));
    (y & 2) << 2 | (x & 2) << 1 | (y & 1) << 1 | x & 1
}

fn shift((x, y): (u32, u32)) -> (u32, u32) {
    let hash = mix(u64::from(x) << 32 | u64::from(y), 0);
    let mask = (1 << BITS) - 1;
    ((hash >> 20) as u32 & mask, (hash >> 40) as u32 & mask)
}

/// Values of a net's cells, row by row.
pub(crate) struct Cells {
    width: usize,
    values: Vec<DVec3>,
}

impl Cells {
    /// Cells for the values of the first 2^`power` points of a pixel.
    pub(crate) fn new(power: u32, pixel: (u32, u32), value: impl Fn(usize) -> DVec3) -> Self {
        let (a, b) = (power.div_ceil(2).min(BITS), (power / 2).min(BITS));
        let (width, height) = (1usize << a, 1usize << b);
        let mut values = vec![DVec3::ZERO; width * height];
        for k in 0..1u32 << power {
            let (x, y) = point(k, pixel);
            values[(y >> (BITS - b)) as usize * width + (x >> (BITS - a)) as usize] = value(k as usize);
        }
        Self { width, values }
    }

    /// The variance of the error of their mean; `corners` are the values at the pixel's corners,
    /// clockwise from the upper left one.
    pub(crate) fn variance(&self, corners: [DVec3; 4]) -> f64 {
        let (w, n) = (self.width, self.values.len());
        let mut sum = 0.0;
        for (i, &v) in self.values.iter().enumerate() {
            if (i + 1) % w != 0 {
                sum += (v - self.values[i + 1]).length_squared();
            }
            if i + w < n {
                sum += (v - self.values[i + w]).length_squared();
            }
        }
        for (k, at) in [0, w - 1, n - 1, n - w].into_iter().enumerate() {
            sum += 0.5 * (self.values[at] - corners[k]).length_squared();
        }
        PAIR * sum / (3.0 * n as f64 * n as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_of_every_grid_has_one_point() {
        for pixel in [(0, 0), (7, 4), (65535, 3)] {
            for power in 0..=8u32 {
                for start in [0, 3 << power] {
                    for a in 0..=power {
                        let mut seen = vec![false; 1 << power];
                        for k in 0..1 << power {
                            let (x, y) = point(start + k, pixel);
                            let cell = (x >> (BITS - a)) << (power - a) | y >> (BITS - (power - a));
                            assert!(!std::mem::replace(&mut seen[cell as usize], true), "{pixel:?} {power} {a}");
                        }
                    }
                }
            }
        }
    }
}
