//! What is left of regions when parts of them are done.

use std::collections::HashMap;

use tessera_core::film::Region;

/// Edge of the fields by which regions find what lies in them.
const FIELD: u32 = 256;

/// The parts of disjoint `regions` that none of `done` covers, each a part of one of them and in their order, or
/// `None` where `done` are not disjoint or reach beyond the regions.
pub(crate) fn rest(regions: &[Region], done: &[Region]) -> Option<Vec<Region>> {
    let fields = |r: &Region| {
        let (columns, rows) = (r.x0 / FIELD..=(r.x1 - 1) / FIELD, r.y0 / FIELD..=(r.y1 - 1) / FIELD);
        rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
    };
    let mut by_field = HashMap::<(u32, u32), Vec<Region>>::new();
    for tile in done {
        fields(tile).for_each(|field| by_field.entry(field).or_default().push(*tile));
    }
    let (mut left, mut covered) = (Vec::new(), 0);
    let mut inside = Vec::new();
    for region in regions {
        inside.clear();
        for tile in fields(region).filter_map(|field| by_field.get(&field)).flatten() {
            inside.extend(common(region, tile));
        }
        // A tile in two fields is found in both.
        inside.sort_unstable();
        inside.dedup();
        match &inside[..] {
            [] => left.push(*region),
            [all] if all == region => covered += region.area(),
            _ => covered += uncovered(region, &inside, &mut left)?,
        }
    }
    let wanted: u64 = done.iter().map(Region::area).sum();
    (covered == wanted).then_some(left)
}

/// The pixels that both have.
fn common(a: &Region, b: &Region) -> Option<Region> {
    Region::new(a.x0.max(b.x0), a.y0.max(b.y0), a.x1.min(b.x1), a.y1.min(b.y1))
}

/// Adds what `tiles`, all within `region`, leave of it to `left`; gives how many pixels they cover, or `None` where
/// two have one in common.
fn uncovered(region: &Region, tiles: &[Region], left: &mut Vec<Region>) -> Option<u64> {
    let width = region.width() as usize;
    let mut taken = vec![false; region.area() as usize];
    for tile in tiles {
        for y in tile.y0..tile.y1 {
            let row = (y - region.y0) as usize * width;
            let (from, to) = ((tile.x0 - region.x0) as usize, (tile.x1 - region.x0) as usize);
            let pixels = &mut taken[row + from..row + to];
            if pixels.iter().any(|&t| t) {
                return None;
            }
            pixels.fill(true);
        }
    }
    // Runs of the row above that may go on below.
    let mut open: Vec<Region> = Vec::new();
    for (y, row) in (region.y0..).zip(taken.chunks_exact(width)) {
        let mut runs = Vec::new();
        let mut x = 0;
        while let Some(from) = row[x..].iter().position(|&t| !t).map(|n| x + n) {
            let to = row[from..].iter().position(|&t| t).map_or(width, |n| from + n);
            runs.push((region.x0 + from as u32, region.x0 + to as u32));
            x = to;
        }
        let mut next = Vec::with_capacity(runs.len());
        for (x0, x1) in runs {
            match open.iter().position(|r| (r.x0, r.x1) == (x0, x1)) {
                Some(i) => next.push(Region { y1: y + 1, ..open.swap_remove(i) }),
                None => next.push(Region { x0, y0: y, x1, y1: y + 1 }),
            }
        }
        left.append(&mut open);
        open = next;
    }
    left.append(&mut open);
    Some(tiles.iter().map(Region::area).sum())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// What is done and what is left are the regions, every pixel once.
        #[test]
        fn nothing_is_left_out_and_nothing_is_there_twice(
            (w, h) in (1u32..600, 1u32..400), edge in 1u32..300, tile in 1u32..90,
            keep in prop::collection::vec(any::<bool>(), 1..50),
        ) {
            prop_assume!(w * h / (tile * tile) < 5000 && w * h / (edge * edge) < 5000);
            let whole = Region { x0: 3, y0: 5, x1: 3 + w, y1: 5 + h };
            let regions = whole.blocks(edge);
            // Tiles of another grid: they lie across regions.
            let done: Vec<Region> =
                whole.blocks(tile).into_iter().enumerate().filter(|(i, _)| keep[i % keep.len()]).map(|(_, t)| t).collect();
            let left = rest(&regions, &done).expect("disjoint and inside");
            let mut times = vec![0u8; whole.area() as usize];
            for r in done.iter().chain(&left) {
                prop_assert!(whole.contains(r));
                for y in r.y0..r.y1 {
                    for x in r.x0..r.x1 {
                        times[((y - 5) * w + x - 3) as usize] += 1;
                    }
                }
            }
            prop_assert!(times.iter().all(|&n| n == 1));
            for r in &left {
                prop_assert!(regions.iter().any(|all| all.contains(r)));
            }
        }
    }

    #[test]
    fn what_is_there_twice_or_outside_is_not_taken() {
        let region = |x0, x1| Region { x0, y0: 0, x1, y1: 8 };
        assert_eq!(rest(&[region(0, 16)], &[region(0, 9), region(8, 16)]), None);
        assert_eq!(rest(&[region(0, 16)], &[region(0, 8), region(0, 8)]), None);
        assert_eq!(rest(&[region(0, 16)], &[region(8, 17)]), None);
        assert_eq!(rest(&[region(0, 8), region(8, 16)], &[region(4, 12)]), Some(vec![region(0, 4), region(12, 16)]));
        assert_eq!(rest(&[region(0, 8)], &[region(0, 8)]), Some(vec![]));
    }
}
