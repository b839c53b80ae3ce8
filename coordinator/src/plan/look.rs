//! Looks at parts of a picture: blocks spread over all of it, and what is seen there.

use std::collections::BTreeMap;

use tessera_core::film::{ErrorEstimate, Region};

use super::model::MODEL;

/// Edge of the blocks.
pub(super) const SPOT: u32 = 8;

/// Blocks of a picture of which one in every field of a grid is looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spots {
    picture: Region,
    /// Blocks across and down.
    wide: u32,
    high: u32,
    /// Fields across and down.
    across: u32,
    down: u32,
}

impl Spots {
    /// What look `number`, counted from 0, sees of `picture`.
    pub(super) fn of(picture: Region, number: usize) -> Self {
        let (least, one_in) = MODEL.looks[number.min(MODEL.looks.len() - 1)];
        Self::over(picture, one_in, least)
    }

    /// One of about `one_in` blocks where those are many, and about `least` at least.
    fn over(picture: Region, one_in: f64, least: f64) -> Self {
        let (wide, high) = (picture.width().div_ceil(SPOT), picture.height().div_ceil(SPOT));
        let blocks = f64::from(wide) * f64::from(high);
        // More blocks tell more, but not in proportion.
        let many = (blocks / one_in / least).max(1.0).sqrt();
        let count = (least * many).min(blocks);
        // As square as the picture allows.
        let fields = |count: f64, blocks: u32| (count.ceil() as u32).clamp(1, blocks);
        let shorter = |blocks: u32, other: u32| fields((count * f64::from(blocks) / f64::from(other)).sqrt(), blocks);
        let longer = |shorter: u32, blocks: u32| fields(count / f64::from(shorter), blocks);
        let (across, down) = if wide <= high {
            let across = shorter(wide, high);
            (across, longer(across, high))
        } else {
            let down = shorter(high, wide);
            (longer(down, wide), down)
        };
        Self { picture, wide, high, across, down }
    }

    /// Whether every block is looked at.
    pub(super) fn are_all(&self) -> bool {
        (self.across, self.down) == (self.wide, self.high)
    }

    pub(super) fn regions(self) -> impl Iterator<Item = Region> {
        let all = (0..self.down).flat_map(move |j| (0..self.across).map(move |i| (i, j)));
        all.map(move |(i, j)| self.region(self.block(i, j)))
    }

    /// First and last block, the last not included, of field `k` of so many.
    fn edges(k: u32, fields: u32, blocks: u32) -> (u32, u32) {
        let edge = |k: u32| (u64::from(k) * u64::from(blocks) / u64::from(fields)) as u32;
        (edge(k), edge(k + 1))
    }

    /// The block of field (i, j) that is looked at, by column and row.
    fn block(&self, i: u32, j: u32) -> (u32, u32) {
        // Fractional parts that fill a square evenly (Roberts, *The unreasonable effectiveness of quasirandom
        // sequences*, 2018).
        let k = u64::from(j) * u64::from(self.across) + u64::from(i);
        let pick = |k: u32, fields: u32, blocks: u32, part: u64| {
            let (from, to) = Self::edges(k, fields, blocks);
            from + ((u64::from(to - from) * (part >> 32)) >> 32) as u32
        };
        let part = |step: u64| k.wrapping_add(1).wrapping_mul(step);
        let x = pick(i, self.across, self.wide, part(0xc13f_a9a9_02a6_328f));
        let y = pick(j, self.down, self.high, part(0x91e1_0da5_c79e_7b1c));
        (x, y)
    }

    fn region(&self, (x, y): (u32, u32)) -> Region {
        let Region { x0, y0, x1, y1 } = self.picture;
        let (left, top) = (x0 + x * SPOT, y0 + y * SPOT);
        Region { x0: left, y0: top, x1: x1.min(left + SPOT), y1: y1.min(top + SPOT) }
    }

    /// What the tiles of a look tell of each field, row by row.
    pub(super) fn fields(&self, tiles: &[(Region, ErrorEstimate)]) -> Fields {
        // A block may have come in several tiles, and these in any order.
        let mut by_block = BTreeMap::<(u32, u32), ErrorEstimate>::new();
        for (region, error) in tiles {
            let block = ((region.x0 - self.picture.x0) / SPOT, (region.y0 - self.picture.y0) / SPOT);
            *by_block.entry(block).or_default() += *error;
        }
        let all = (0..self.down).flat_map(|j| (0..self.across).map(move |i| (i, j)));
        let of = |(i, j)| by_block.get(&self.block(i, j)).copied().unwrap_or_default();
        Fields { spots: *self, errors: all.map(of).collect() }
    }
}

/// What was seen in every field of a picture.
#[derive(Clone, Debug)]
pub(super) struct Fields {
    spots: Spots,
    errors: Vec<ErrorEstimate>,
}

impl Fields {
    /// Points a pixel that were expected in each field, within the tolerance of the look.
    pub(super) fn expected_points(&self, points: impl Fn(&ErrorEstimate) -> f64) -> ExpectedPoints {
        ExpectedPoints { spots: self.spots, points: self.errors.iter().map(points).collect() }
    }

    /// Standard error of the root mean square that was seen, as a share of it. What lies between the blocks
    /// differs from them as they do from their neighbours.
    pub(super) fn doubt(&self) -> f64 {
        let Spots { wide, high, across, down, .. } = self.spots;
        let at = |i: u32, j: u32| {
            let e = &self.errors[(j * across + i) as usize];
            if e.pixels == 0 { 0.0 } else { e.squares.value() / e.pixels as f64 }
        };
        let (mut apart, mut pairs, mut sum) = (0.0, 0.0, 0.0);
        for j in 0..down {
            for i in 0..across {
                let here = at(i, j);
                sum += here;
                for (other, inside) in [((i + 1, j), i + 1 < across), ((i, j + 1), j + 1 < down)] {
                    if inside {
                        let d = here - at(other.0, other.1);
                        (apart, pairs) = (apart + 0.5 * d * d, pairs + 1.0);
                    }
                }
            }
        }
        let n = f64::from(across) * f64::from(down);
        if !(sum > 0.0 && pairs > 0.0) {
            return 0.0;
        }
        let unseen = 1.0 - n / (f64::from(wide) * f64::from(high));
        // A root's relative error is half of what is beneath it.
        0.5 * (unseen.max(0.0) * n * apart / pairs).sqrt() / sum
    }
}

/// How many points are expected in which part of a picture.
#[derive(Clone, Debug)]
pub(super) struct ExpectedPoints {
    spots: Spots,
    /// Points a pixel in each field, row by row.
    points: Vec<f64>,
}

impl ExpectedPoints {
    /// Expected points in `region`.
    pub(super) fn of(&self, region: &Region) -> f64 {
        let Spots { picture, wide, high, across, down } = self.spots;
        // Pixels that a field and the region have in common along an axis.
        let common = |k: u32, (fields, blocks): (u32, u32), (from, to): (u32, u32)| {
            let (first, last) = Spots::edges(k, fields, blocks);
            f64::from((last * SPOT).min(to).saturating_sub((first * SPOT).max(from)))
        };
        let (x, y) =
            ((region.x0 - picture.x0, region.x1 - picture.x0), (region.y0 - picture.y0, region.y1 - picture.y0));
        let mut sum = 0.0;
        for j in 0..down {
            let rows = common(j, (down, high), y);
            if rows > 0.0 {
                for i in 0..across {
                    sum += rows * common(i, (across, wide), x) * self.points[(j * across + i) as usize];
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tessera_core::film::Sum;

    use super::*;

    #[test]
    fn the_more_blocks_differ_from_their_neighbours_the_more_is_in_doubt() {
        let spots = Spots::of(Region { x0: 0, y0: 0, x1: 640, y1: 480 }, 0);
        let doubt = |squares: &dyn Fn(u32) -> f64| {
            let of = |r: Region| {
                (r, ErrorEstimate { pixels: r.area(), squares: Sum::new(squares(r.x0)), ..Default::default() })
            };
            spots.fields(&spots.regions().map(of).collect::<Vec<_>>()).doubt()
        };
        let ragged = |x: u32| f64::from((x / SPOT).wrapping_mul(0x9e37_79b9) >> 22);
        let (even, slope, ragged) = (doubt(&|_| 500.0), doubt(&|x| f64::from(x)), doubt(&ragged));
        assert_eq!(even, 0.0);
        assert!(0.0 < slope && 2.0 * slope < ragged && ragged < 0.5, "{slope}, {ragged}");
    }

    #[test]
    fn the_expected_points_of_parts_are_those_of_the_whole() {
        let picture = Region { x0: 0, y0: 0, x1: 650, y1: 483 };
        let spots = Spots::of(picture, 1);
        let tiles: Vec<_> = spots.regions().map(|r| (r, ErrorEstimate { pixels: 64, ..Default::default() })).collect();
        let fields = spots.fields(&tiles);
        assert!((fields.expected_points(|_| 5.0).of(&picture) - 5.0 * picture.area() as f64).abs() < 1.0);
        let expected = ExpectedPoints {
            points: (0..tiles.len()).map(|k| (k * k % 17) as f64).collect(),
            ..fields.expected_points(|_| 0.0)
        };
        let parts: f64 = picture.blocks(37).iter().map(|r| expected.of(r)).sum();
        assert!((parts / expected.of(&picture) - 1.0).abs() < 1e-9);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        #[test]
        fn blocks_are_about_as_many_as_meant_and_in_the_picture(
            (x0, y0) in (0u32..5000, 0u32..5000),
            (w, h) in (1u32..3000, 1u32..3000),
            narrow in 0u32..3,
        ) {
            let (w, h) = match narrow {
                0 => (w, h),
                1 => (w, h % 20 + 1),
                _ => (w % 20 + 1, h),
            };
            let picture = Region { x0, y0, x1: x0 + w, y1: y0 + h };
            let blocks = f64::from(w.div_ceil(SPOT)) * f64::from(h.div_ceil(SPOT));
            for (number, (least, _)) in MODEL.looks.into_iter().enumerate() {
                let spots = Spots::of(picture, number);
                let regions: Vec<Region> = spots.regions().collect();
                let some = regions.len() as f64;
                prop_assert!(some >= 0.99 * least.min(blocks), "{some} for {least}");
                prop_assert!(some <= (blocks / 20.0).max(1.5 * least + 20.0), "{some} for {least}");
                prop_assert_eq!(spots.are_all(), some == blocks);
                let mut corners: Vec<_> = regions.iter().map(|r| (r.x0, r.y0)).collect();
                corners.sort_unstable();
                corners.dedup();
                prop_assert_eq!(corners.len(), regions.len());
                prop_assert!(regions.iter().all(|r| r.area() > 0 && picture.contains(r)));
            }
        }
    }
}
