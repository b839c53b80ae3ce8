//! Points spread over a pixel so evenly that any few of them are, and the error of their mean.

use glam::{DVec2, DVec3};

use super::lattice::UNIT;
use crate::trace::{PlanePoint, mix};

/// The most points of a pixel, as a power of two: each has a row and a column of the lattice to itself.
pub(crate) const MOST: u32 = UNIT.ilog2() - 1;
/// Bits of a coordinate.
const BITS: u32 = MOST;
/// The variance of a mean over a net per pair of neighbours that differ, and their difference's
/// square. An edge passes 1.27 such pairs a cell's width, and as many cells; in each, its share
/// of the area has a variance of 1/6 at most about what one point shows.
const PAIR: f64 = 1.0 / 6.0;
/// What is left of that, for every doubling from 2^[`FEW`] to 2^[`MANY`] points: where many cells
/// meet an edge, their errors cancel. Measured over scenes of all kinds, and still on the safe side.
const CANCEL: f64 = 0.76;
const FEW: u32 = 4;
const MANY: u32 = 7;

/// The two-dimensional Sobol sequence in 1/2048 pixel: every run of 2^m points from a multiple of
/// 2^m on has one point in each of the 2^m cells of any grid of 2^a × 2^(m − a).
static POINTS: [(u16, u16); 1 << MOST] = {
    let mut points = [(0, 0); 1 << MOST];
    let mut k = 0u32;
    while k < 1 << MOST {
        let (mut y, mut column, mut bits) = (0, 1u32 << 31, k);
        while bits != 0 {
            if bits & 1 == 1 {
                y ^= column;
            }
            column ^= column >> 1;
            bits >>= 1;
        }
        points[k as usize] = ((k.reverse_bits() >> (32 - BITS)) as u16, (y >> (32 - BITS)) as u16);
        k += 1;
    }
    points
};

/// For every run of 16 points, which is in each of 4 × 4 cells, quarter by quarter.
static RUNS: [[u16; 16]; 1 << (MOST - 4)] = {
    let mut runs = [[0; 16]; 1 << (MOST - 4)];
    let mut k = 0;
    while k < 1 << MOST {
        runs[k / 16][quarters(POINTS[k].0 as u32, POINTS[k].1 as u32) as usize] = k as u16;
        k += 1;
    }
    runs
};

/// Which of 4 × 4 cells a point is in, quarter by quarter.
const fn quarters(x: u32, y: u32) -> u32 {
    let (x, y) = (x >> (BITS - 2), y >> (BITS - 2));
    (y & 2) << 2 | (x & 2) << 1 | (y & 1) << 1 | x & 1
}

/// A pixel's points: the sequence, turned by a digital shift of the pixel's own.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Net {
    x: u32,
    y: u32,
}

impl Net {
    /// The points of pixel (x, y).
    pub(crate) fn of((x, y): (u32, u32)) -> Self {
        let hash = mix(u64::from(x) << 32 | u64::from(y), 0);
        let mask = (1 << BITS) - 1;
        Self { x: (hash >> 20) as u32 & mask, y: (hash >> 40) as u32 & mask }
    }

    /// The k-th point, in 1/2048 pixel from the upper left corner.
    pub(crate) fn point(self, k: u32) -> (u32, u32) {
        let (x, y) = POINTS[k as usize];
        (u32::from(x) ^ self.x, u32::from(y) ^ self.y)
    }

    /// The k-th point in the pixel whose upper left corner is `origin`.
    pub(crate) fn point_of(self, origin: PlanePoint, k: u32) -> PlanePoint {
        const { assert!(UNIT == 2 << BITS) };
        let (x, y) = self.point(k);
        PlanePoint { x: origin.x + 2 * x as i32 + 1, y: origin.y - 2 * y as i32 - 1 }
    }

    /// Where the k-th point is, in pixels from the upper left corner.
    pub(crate) fn place(self, k: u32) -> DVec2 {
        let (x, y) = self.point(k);
        DVec2::new(f64::from(2 * x + 1), f64::from(2 * y + 1)) * (1.0 / f64::from(UNIT))
    }

    /// The `from`-th to the `to`-th point, of 4 × 4 cells one after the other where there are many.
    pub(crate) fn side_by_side(self, from: u32, to: u32) -> impl Iterator<Item = u32> {
        let turn = quarters(self.x, self.y);
        let few = if to <= 16 { from..to } else { 0..0 };
        let runs = if to <= 16 { 0..0 } else { from / 16..to / 16 };
        let many = (0..16).flat_map(move |cell| {
            let run = move |r: u32| u32::from(RUNS[r as usize][(cell ^ turn) as usize]);
            runs.clone().map(run).filter(move |k| *k >= from)
        });
        few.chain(many)
    }
}

/// Values of a net's cells, row by row.
pub(crate) struct Cells<'a> {
    width: usize,
    values: &'a [DVec3],
}

impl<'a> Cells<'a> {
    /// Cells for the values of the first 2^`power` points of `net`, in `memory`.
    pub(crate) fn new(power: u32, net: Net, value: impl Fn(usize) -> DVec3, memory: &'a mut Vec<DVec3>) -> Self {
        let (a, b) = (power.div_ceil(2).min(BITS), (power / 2).min(BITS));
        memory.clear();
        memory.resize(1 << (a + b), DVec3::ZERO);
        for k in 0..1u32 << power {
            let (x, y) = net.point(k);
            memory[(y >> (BITS - b) << a | x >> (BITS - a)) as usize] = value(k as usize);
        }
        Self { width: 1 << a, values: memory }
    }

    /// The variance of the error of their mean; `corners` are the values at the pixel's corners,
    /// clockwise from the upper left one.
    pub(crate) fn variance(&self, corners: [DVec3; 4]) -> f64 {
        let (w, n) = (self.width, self.values.len());
        let mut sum = 0.0;
        for row in self.values.chunks_exact(w) {
            sum += row.windows(2).map(|pair| (pair[0] - pair[1]).length_squared()).sum::<f64>();
        }
        for (a, b) in self.values.iter().zip(&self.values[w..]) {
            sum += (*a - *b).length_squared();
        }
        for (k, at) in [0, w - 1, n - 1, n - w].into_iter().enumerate() {
            sum += 0.5 * (self.values[at] - corners[k]).length_squared();
        }
        let doublings = n.ilog2().clamp(FEW, MANY) - FEW;
        let cancelled = (0..doublings).fold(PAIR, |share, _| share * CANCEL);
        cancelled * sum / (3.0 * n as f64 * n as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_of_every_grid_has_one_point() {
        for pixel in [(0, 0), (7, 4), (65535, 3)] {
            let net = Net::of(pixel);
            for power in 0..MOST {
                for start in (0..1 << MOST).step_by(1 << power) {
                    for a in 0..=power {
                        let mut seen = vec![false; 1 << power];
                        for k in 0..1 << power {
                            let (x, y) = net.point(start + k);
                            let cell = (x >> (BITS - a)) << (power - a) | y >> (BITS - (power - a));
                            assert!(!std::mem::replace(&mut seen[cell as usize], true), "{pixel:?} {power} {a}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn points_side_by_side_are_all_asked_for() {
        let net = Net::of((19, 5));
        for (from, to) in [(0, 4), (4, 16), (4, 32), (16, 128), (0, 2048)] {
            let mut asked: Vec<u32> = net.side_by_side(from, to).collect();
            asked.sort_unstable();
            assert!(asked.into_iter().eq(from..to), "{from} to {to}");
        }
    }
}
