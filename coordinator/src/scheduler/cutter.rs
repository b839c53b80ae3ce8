//! The part of the picture nobody has been given yet, cut into regions as they are needed.

use tessera_core::film::Region;
use tessera_proto::limits::MAX_TILE_PIXELS;

use crate::config::TileSize;

/// Edges of cut regions fall on multiples of this, counted from the picture's region.
const GRAIN: u32 = 8;

/// Gives out disjoint regions that together are the whole: a grid of cells, walked row by row
/// and never held, and cells halved until they have the area asked for.
#[derive(Debug)]
pub(super) struct Cutter {
    whole: Region,
    /// Cells across and down.
    grid: (u32, u32),
    /// Cells are this wide and high; the last ones may be less.
    cell: (u32, u32),
    /// Whether cells may be halved.
    halving: bool,
    next_cell: u64,
    /// Halves and regions given back, the newest first.
    spare: Vec<Region>,
    pixels_left: u64,
}

impl Cutter {
    pub(super) fn new(whole: Region, tile: TileSize) -> Self {
        let cells = |length: u32, edge: u32| length.div_ceil(edge);
        let (cell, halving) = match tile {
            TileSize::Edge(n) => {
                let n = n.clamp(1, TileSize::MAX_EDGE);
                ((n, n), false)
            }
            TileSize::Auto => {
                let even = |length: u32| {
                    let count = cells(length, TileSize::MAX_EDGE);
                    length.div_ceil(count).next_multiple_of(GRAIN).min(TileSize::MAX_EDGE)
                };
                ((even(whole.width()), even(whole.height())), true)
            }
        };
        let grid = (cells(whole.width(), cell.0), cells(whole.height(), cell.1));
        Self { whole, grid, cell, halving, next_cell: 0, spare: Vec::new(), pixels_left: whole.area() }
    }

    /// Of disjoint regions, the first to be given out first.
    pub(super) fn of(whole: Region, mut regions: Vec<Region>, tile: TileSize) -> Self {
        regions.reverse();
        let pixels_left = regions.iter().map(Region::area).sum();
        let halving = tile == TileSize::Auto;
        Self { whole, grid: (0, 0), cell: (1, 1), halving, next_cell: 0, spare: regions, pixels_left }
    }

    /// Pixels not given out.
    pub(super) fn pixels_left(&self) -> u64 {
        self.pixels_left
    }

    /// Regions that the rest would make if each had `area` pixels.
    pub(super) fn regions_left(&self, area: u64) -> u64 {
        if self.halving {
            self.pixels_left.div_ceil(area.clamp(1, MAX_TILE_PIXELS))
        } else {
            u64::from(self.grid.0) * u64::from(self.grid.1) - self.next_cell + self.spare.len() as u64
        }
    }

    /// A region of about `area` pixels, or the nearest there is.
    pub(super) fn take(&mut self, area: u64) -> Option<Region> {
        let mut region = self.spare.pop().or_else(|| self.cell_at(self.next_cell))?;
        while self.halving && 2 * region.area() > 3 * area {
            let Some((first, second)) = halve(region) else { break };
            self.spare.push(second);
            region = first;
        }
        self.pixels_left -= region.area();
        Some(region)
    }

    /// Takes back a region that nobody began.
    pub(super) fn give_back(&mut self, region: Region) {
        self.pixels_left += region.area();
        self.spare.push(region);
    }

    /// Regions that are kept one by one.
    #[cfg(test)]
    pub(super) fn spares(&self) -> usize {
        self.spare.len()
    }

    fn cell_at(&mut self, index: u64) -> Option<Region> {
        let columns = u64::from(self.grid.0);
        if columns == 0 {
            return None;
        }
        let (column, row) = ((index % columns) as u32, u32::try_from(index / columns).ok()?);
        if row >= self.grid.1 {
            return None;
        }
        self.next_cell += 1;
        let (x0, y0) = (self.whole.x0 + column * self.cell.0, self.whole.y0 + row * self.cell.1);
        Region::new(x0, y0, self.whole.x1.min(x0 + self.cell.0), self.whole.y1.min(y0 + self.cell.1))
    }
}

/// Cuts across the longer side, or not at all where it is too short.
fn halve(r: Region) -> Option<(Region, Region)> {
    let middle = |length: u32| (length / 2).next_multiple_of(GRAIN);
    if r.width() > r.height() {
        let x = r.x0 + middle(r.width());
        Some((Region::new(r.x0, r.y0, x, r.y1)?, Region::new(x, r.y0, r.x1, r.y1)?))
    } else {
        let y = r.y0 + middle(r.height());
        Some((Region::new(r.x0, r.y0, r.x1, y)?, Region::new(r.x0, y, r.x1, r.y1)?))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// What is given out covers every pixel once, whatever sizes are asked for.
        #[test]
        fn regions_tile_the_whole(
            (x0, y0) in (0u32..50, 0u32..50), (w, h) in (1u32..700, 1u32..700),
            edge in prop::option::of(1u32..300),
            areas in prop::collection::vec(1u64..100_000, 1..20),
        ) {
            let whole = Region::new(x0, y0, x0 + w, y0 + h).unwrap();
            // Many tiny regions of a large picture would only take long.
            prop_assume!(edge.is_none_or(|e| w * h / (e * e) < 5000));
            let mut cutter = Cutter::new(whole, edge.map_or(TileSize::Auto, TileSize::Edge));
            let mut seen = vec![false; whole.area() as usize];
            let mut turn = 0;
            let mut left = whole.area();
            while let Some(r) = cutter.take(areas[turn % areas.len()].max(100)) {
                turn += 1;
                if turn % 7 == 0 {
                    cutter.give_back(r);
                    continue;
                }
                prop_assert!(whole.contains(&r) && r.area() <= MAX_TILE_PIXELS);
                left -= r.area();
                prop_assert_eq!(cutter.pixels_left(), left);
                for y in r.y0..r.y1 {
                    for x in r.x0..r.x1 {
                        let pixel = &mut seen[((y - y0) * w + x - x0) as usize];
                        prop_assert!(!*pixel);
                        *pixel = true;
                    }
                }
            }
            prop_assert_eq!(left, 0);
            prop_assert_eq!(cutter.regions_left(100), 0);
        }
    }

    #[test]
    fn a_huge_picture_of_tiny_tiles_takes_no_memory_before_it_is_cut() {
        let whole = Region::new(0, 0, 65_536, 65_536).unwrap();
        let mut cutter = Cutter::new(whole, TileSize::Edge(1));
        assert_eq!(cutter.regions_left(1), 1 << 32);
        assert_eq!(cutter.take(1).unwrap().area(), 1);
        assert!(cutter.spare.is_empty());
    }
}
