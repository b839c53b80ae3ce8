//! Points of a pixel: scrambled sequences, another one in each pixel.
//!
//! Sobol's first two dimensions, a (0, 2)-sequence in base 2: of its first 4ᵏ points, and of every later
//! run of as many, one lies in each of the 2ᵏ × 2ᵏ squares of a pixel. Scrambled as Owen does (*Randomly
//! permuted (t, m, s)-nets and (t, s)-sequences*, 1995) by hashes (Burley, *Practical hash-based Owen
//! scrambling*, JCGT 9(4), 2020). A point is a function of pixel, set and number alone, and sets have
//! nothing in common, nor have pixels: no scene is regular enough to meet them all at the same phase.

use crate::film::{GRID, PlanePoint, Region, UNIT};
use crate::settings::View;

/// Bits of a point's place along an axis of its pixel.
const BITS: u32 = UNIT.trailing_zeros() - 1;

/// A mixing step of 64 bits (the finaliser of SplitMix64).
pub(crate) fn mix(hash: u64, word: u64) -> u64 {
    let x = (hash ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A number in [0, 2³²) for pixel (x, y), another for every `purpose`.
pub(crate) fn hash(x: u32, y: u32, purpose: u64) -> u64 {
    mix(mix(0x5eed, u64::from(x) << 32 | u64::from(y)), purpose)
}

/// The Laine–Karras permutation: bits depend on lower ones alone.
fn permute(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// The second dimension's number of a point, bits reversed.
const fn second(mut index: u32) -> u32 {
    let (mut v, mut r) = (1u32 << 31, 0);
    while index != 0 {
        if index & 1 == 1 {
            r ^= v;
        }
        index >>= 1;
        v ^= v >> 1;
    }
    r.reverse_bits()
}

/// The same of the first points, which most pixels have no more than.
const SECONDS: [u32; 64] = {
    let mut all = [0; 64];
    let mut k = 0;
    while k < all.len() {
        all[k] = second(k as u32);
        k += 1;
    }
    all
};

/// One scrambled sequence of a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sequence {
    /// The pixel's lower left corner.
    corner: PlanePoint,
    seeds: [u32; 2],
}

impl Sequence {
    /// Set `set` of pixel (x, y) of a picture under `view`.
    pub(crate) fn new(view: &View, (x, y): (u32, u32), set: u64) -> Self {
        let seed = hash(x, y, set);
        Self { corner: corner(view, x, y), seeds: [seed as u32, (seed >> 32) as u32] }
    }

    /// Its `index`-th point.
    #[inline]
    pub(crate) fn point(&self, index: u32) -> PlanePoint {
        let [x, y] = self.bits(index).map(|b| (b >> (32 - BITS)) as i32 * 2 + 1);
        PlanePoint { x: self.corner.x + x, y: self.corner.y + y }
    }

    /// Its `index`-th point in the unit square.
    pub(crate) fn unit(&self, index: u32) -> [f64; 2] {
        self.bits(index).map(|b| (f64::from(b) + 0.5) / 4_294_967_296.0)
    }

    #[inline]
    fn bits(&self, index: u32) -> [u32; 2] {
        let scrambled = |reversed: u32, seed: u32| permute(reversed, seed).reverse_bits();
        let second = SECONDS.get(index as usize).copied().unwrap_or_else(|| second(index));
        [scrambled(index, self.seeds[0]), scrambled(second, self.seeds[1])]
    }

    /// The point at a place of the pixel, 0 to 1 from the left and from below.
    pub(crate) fn at(&self, place: [f64; 2]) -> PlanePoint {
        let cells = f64::from(1u32 << BITS);
        let [x, y] = place.map(|p| (p * cells).clamp(0.0, cells - 1.0) as i32 * 2 + 1);
        PlanePoint { x: self.corner.x + x, y: self.corner.y + y }
    }

    /// Which of the pixel's 2^level × 2^level squares a point of it lies in.
    pub(crate) fn square(&self, p: PlanePoint, level: u32) -> u32 {
        let [x, y] = [p.x - self.corner.x, p.y - self.corner.y].map(|d| d as u32 >> (UNIT.trailing_zeros() - level));
        y << level | x
    }

    /// Where a point of the pixel is, 0 to 1 from the left and from below.
    pub(crate) fn place(&self, p: PlanePoint) -> [f64; 2] {
        [p.x - self.corner.x, p.y - self.corner.y].map(|d| f64::from(d) / f64::from(UNIT))
    }
}

/// The lower left corner of pixel (x, y), y down.
pub(crate) fn corner(view: &View, x: u32, y: u32) -> PlanePoint {
    let half = |pixels: u32| i64::from(pixels) * i64::from(GRID);
    // At most 2³⁰ in magnitude: 2¹⁵ units times half of 2¹⁶ pixels.
    PlanePoint {
        x: (i64::from(x) * i64::from(UNIT) - half(view.width())) as i32,
        y: (half(view.height()) - (i64::from(y) + 1) * i64::from(UNIT)) as i32,
    }
}

/// The centre of pixel (x, y).
pub(crate) fn centre(view: &View, x: u32, y: u32) -> PlanePoint {
    let c = corner(view, x, y);
    PlanePoint { x: c.x + UNIT / 2, y: c.y + UNIT / 2 }
}

/// `region` and the pixels around it, as far as there are any in the square of `edge` × `edge` pixels that it lies in.
pub(crate) fn with_apron(region: Region, edge: u32, view: &View) -> Region {
    let around = |from: u32, to: u32, size: u32| {
        let square = from / edge * edge;
        (from.saturating_sub(1).max(square), (to + 1).min(square.saturating_add(edge)).min(size))
    };
    let ((x0, x1), (y0, y1)) =
        (around(region.x0, region.x1, view.width()), around(region.y0, region.y1, view.height()));
    Region { x0, y0, x1, y1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(x: u32, y: u32) -> Sequence {
        Sequence::new(&View::new(64, 48, 1.0, 1.0).expect("a view"), (x, y), 0)
    }

    #[test]
    fn every_run_of_a_power_of_four_is_stratified_in_all_shapes() {
        for (x, y) in [(0, 0), (17, 40), (63, 47)] {
            let s = sequence(x, y);
            for (k, from) in [(2, 0), (4, 0), (4, 16), (6, 64), (8, 256), (8, 768)] {
                let points: Vec<_> = (from..from + (1 << k))
                    .map(|i| s.point(i))
                    .map(|p| ((p.x - s.corner.x) as u32, (p.y - s.corner.y) as u32))
                    .collect();
                for across in 0..=k {
                    let mut met = vec![false; 1 << k];
                    for (px, py) in &points {
                        assert!(*px < UNIT as u32 && *py < UNIT as u32);
                        let column = *px >> (15 - across);
                        let row = *py >> (15 - (k - across));
                        let cell = &mut met[(column << (k - across) | row) as usize];
                        assert!(!*cell, "two of {k} at {across}");
                        *cell = true;
                    }
                }
            }
        }
    }

    #[test]
    fn pixels_have_nothing_in_common() {
        // The first points of many pixels fill a pixel evenly.
        let (mut sum, mut cells) = ([0.0; 2], [0u32; 16]);
        for i in 0..64 {
            for j in 0..48 {
                let s = sequence(i, j);
                let p = s.point(0);
                let (x, y) = (p.x - s.corner.x, p.y - s.corner.y);
                sum = [sum[0] + f64::from(x), sum[1] + f64::from(y)];
                cells[((x >> 13) * 4 + (y >> 13)) as usize] += 1;
            }
        }
        let n = 64.0 * 48.0;
        assert!(sum.iter().all(|s| (s / n / f64::from(UNIT) - 0.5).abs() < 0.02));
        assert!(cells.iter().all(|&c| (130..260).contains(&c)), "{cells:?}");
    }

    #[test]
    fn corners_and_centres_are_where_the_plane_has_them() {
        let view = View::new(64, 48, 1.0, 1.0).expect("a view");
        assert_eq!(corner(&view, 32, 23), PlanePoint { x: 0, y: 0 });
        assert_eq!(centre(&view, 0, 0), PlanePoint { x: -32 * UNIT + UNIT / 2, y: 24 * UNIT - UNIT / 2 });
    }
}
