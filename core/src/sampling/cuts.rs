//! Which cells are cut.

use super::cells::{Cell, Cut};

/// A cell is worth halving where its variance is so many times what a point must take off: that takes two
/// points, of which some are shared, and takes off a half or more.
const HALVING: f64 = 4.0;
/// A cell is halved twice in one go where it is worth it so many times, and once more for every further time.
const TWICE: f64 = 16.0;
/// Halvings in one go at most.
const GO: u32 = 4;
/// Where a pixel has more cells, none is halved.
const MOST: usize = 2048;
/// Differences along an edge that is taken to run along an axis, as a share of those across it, in squares.
const ALONG: f32 = 1.0 / 64.0;
/// The least part of what is enough, or fixed, that variances are brought down to.
const PART: f64 = 0.1;

/// The error of what a cell adds to its pixel's mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Error {
    pub(super) variance: f64,
    /// The variance of its corners, or what that is taken to be at least.
    pub(super) spread: f64,
    /// How much what it shows differs from left to right, and from top to bottom.
    pub(super) across: f32,
    pub(super) down: f32,
}

/// What ends the search for a pixel's value.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// The variance that is enough.
    pub(super) enough: f64,
    /// The variance that a point must take off to be worth it; none where only what is enough counts.
    pub(super) a_point: Option<f64>,
}

/// Which cells are cut, whose errors add up, and to `fixed` that no point takes off, and how; none where the
/// pixel is done.
pub(super) fn next(cells: &[Cell], fixed: f64, limits: Limits, cuts: &mut Vec<(usize, Cut)>) {
    cuts.clear();
    let (mut all, mut fixed, mut roots) = (0.0, fixed, 0.0);
    for cell in cells {
        let variance = cell.error.map_or(0.0, |e| e.variance);
        if cell.divisible() {
            all += variance;
            roots += variance.sqrt();
        } else {
            fixed += variance;
        }
    }
    // What is fixed may be more than enough: then the rest need not be less than a part of it.
    let enough = (limits.enough - fixed).max(PART * limits.enough.max(fixed));
    let Some(go) = (MOST / cells.len()).checked_ilog2().map(|go| go.min(GO)) else { return };
    if all <= enough || go == 0 {
        return;
    }
    let worth = match limits.a_point {
        Some(a_point) => HALVING * a_point,
        None => {
            // Halved t times, a cell leaves variances of a 4^t-th of its own, in all a 2^t-th. If all are brought
            // down to the same, that is enough where they are these. Towards that it goes half the way at a time, for
            // errors may fall faster.
            let each = enough / roots;
            each * each
        }
    };
    let along = |e: &Error| e.across < ALONG * e.down || e.down < ALONG * e.across;
    for (at, cell) in cells.iter().enumerate() {
        let Some(e) = cell.error else { continue };
        let times = e.variance / worth;
        if times >= 1.0 && cell.divisible() {
            let cut = Cut {
                times: (libm::log(times) / libm::log(TWICE)).min(f64::from(go - 1)) as u32 + 1,
                upright: if along(&e) { e.across > e.down } else { cell.upright(e.across, e.down) },
                along: along(&e),
            };
            cuts.push((at, cut));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::cells::tests::pixel;

    /// Which of `cells` are cut, and how often.
    fn cuts(cells: &[Cell], fixed: f64, limits: Limits) -> Vec<(usize, u32)> {
        let mut cuts = Vec::new();
        next(cells, fixed, limits, &mut cuts);
        cuts.iter().map(|(at, cut)| (*at, cut.times)).collect()
    }

    /// Four cells of such variances.
    fn quarters(variances: [f64; 4]) -> Vec<Cell> {
        let mut cells = pixel();
        cells.cut(&[(0, Cut { times: 2, upright: true, along: false })]);
        let error = |variance| Some(Error { variance, across: 1.0, ..Error::default() });
        cells.cells.iter_mut().zip(variances).for_each(|(c, v)| c.error = error(v));
        cells.cells
    }

    #[test]
    fn what_is_worth_it_is_cut() {
        let limits = Limits { enough: 1e-9, a_point: Some(1e-6) };
        let cells = quarters([1e-5, 1e-7, 1e-1, 0.0]);
        assert_eq!(cuts(&cells, 0.0, limits), [(0, 1), (2, 4)]);
        let mut found = Vec::new();
        next(&cells, 0.0, limits, &mut found);
        assert!(found.iter().all(|(_, c)| c.upright));
    }

    #[test]
    fn it_ends_where_nothing_is_worth_a_point_or_all_is_enough() {
        let found = quarters([1e-7; 4]);
        assert_eq!(cuts(&found, 0.0, Limits { enough: 1e-5, a_point: None }), []);
        assert_eq!(cuts(&found, 0.0, Limits { enough: 1e-9, a_point: Some(1e-3) }), []);
    }

    #[test]
    fn what_no_point_takes_off_is_not_chased() {
        let limits = Limits { enough: 1e-6, a_point: None };
        assert_eq!(cuts(&quarters([1e-5; 4]), 1e-2, limits), []);
        assert_eq!(cuts(&quarters([0.0; 4]), 1e-2, limits), []);
    }

    #[test]
    fn towards_what_is_enough_all_are_brought_down_to_the_same() {
        let limits = Limits { enough: 1e-4, a_point: None };
        assert_eq!(cuts(&quarters([1e-7, 1e-3, 1e-5, 1e-7]), 0.0, limits), [(1, 2), (2, 1)]);
    }

    #[test]
    fn it_always_goes_on_until_then() {
        for a_point in [None, Some(1e-9), Some(1e-4)] {
            let limits = Limits { enough: 1e-6, a_point };
            let (mut cells, mut cuts) = (pixel(), Vec::new());
            let mut rounds = 0;
            loop {
                // However much is done, errors are beyond all measure.
                cells.cells.iter_mut().for_each(|c| c.error = Some(Error { variance: 1e9, ..Error::default() }));
                next(&cells.cells, 0.5, limits, &mut cuts);
                if cuts.is_empty() {
                    break;
                }
                cells.cut(&cuts);
                rounds += 1;
                assert!(rounds <= 20);
            }
        }
    }
}
