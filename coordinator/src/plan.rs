//! Which passes over the picture lead to the accuracy asked for, as a pure state machine.
//!
//! A pass renders regions within a tolerance. What it gives depends on the scene, the settings
//! and the tolerance alone; the next tolerance follows from the estimates of the passes
//! before. Towards an error no clock is read, so that the picture is the same wherever and by
//! however many it was rendered.

use std::collections::BTreeMap;
use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::settings::Tolerance;

/// How good a picture is to be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Goal {
    /// As the settings' sampling says.
    #[default]
    AsSet,
    /// Adaptive, with about this root mean squared error, as a fraction of full scale.
    Error(f64),
    /// Adaptive, the best there is when time is up, or this error if it is reached before.
    Time {
        /// From the beginning of the render.
        limit: Duration,
        /// The error that is enough.
        error: Option<f64>,
    },
}

/// A pass to be rendered.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Step {
    /// Within what; `None` as the settings say.
    pub(crate) tolerance: Option<Tolerance>,
    /// Over what, the most rewarding first; the whole picture where empty.
    pub(crate) regions: Vec<Region>,
    /// Whether its pixels belong into the picture.
    pub(crate) kept: bool,
    /// How many times as dear a pixel is expected to be as in the pass before.
    pub(crate) dearer: f64,
}

/// What a pass gave.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outcome {
    /// The estimate over all of it.
    pub(crate) error: ErrorEstimate,
    /// Tiles and their estimates, where [`Plan::wants_tiles`].
    pub(crate) tiles: Vec<(Region, ErrorEstimate)>,
    /// How long it took.
    pub(crate) took: Duration,
    /// Since the render began.
    pub(crate) now: Duration,
}

/// Edge of the blocks that are looked at first towards an error.
const SPOT: u32 = 8;
/// At the first look one of about so many blocks is seen, and about so many at least: it finds the tolerance
/// roughly. At the second more of them are: it tells how that one does.
const LOOKS: [(f64, f64); 2] = [(160.0, 60.0), (40.0, 200.0)];
/// The share of the error asked for that is aimed at after the first look, and after a whole picture: estimates
/// err.
const AIM: f64 = 0.9;
/// What is aimed at after the last look is less by this share, and by what is in doubt.
const SURE: f64 = 0.04;
/// And no less than this share.
const LEAST_AIM: f64 = 0.75;
/// So many times the error that was seen is aimed at, at most.
const COARSER: f64 = 3.0;
/// Errors fall with the tolerance to about this power, over the scenes measured.
const ERROR_POWER: f64 = 0.6;
/// Time rises with the inverse of the tolerance to about this power.
const TIME_POWER: f64 = 0.6;
/// The tolerance of the first picture under a time limit.
const FIRST: f64 = 8.0 / 255.0;
/// The share of the time left that the next pass is to take.
const SHARE: f64 = 0.4;

/// See the [module](self).
#[derive(Debug)]
pub(crate) struct Plan {
    goal: Goal,
    region: Region,
    tolerance: Tolerance,
    looks: usize,
    whole: u32,
}

impl Plan {
    pub(crate) fn new(goal: Goal, region: Region) -> Self {
        Self { goal, region, tolerance: Tolerance::new(FIRST), looks: 0, whole: 0 }
    }

    /// The first pass.
    pub(crate) fn first(&mut self) -> Step {
        match self.goal {
            Goal::AsSet => Step { tolerance: None, regions: Vec::new(), kept: true, dearer: 1.0 },
            Goal::Error(error) => {
                self.tolerance = Tolerance::new(error);
                self.look()
            }
            Goal::Time { .. } => self.render(self.tolerance, Vec::new()),
        }
    }

    /// The pass after the one that gave `outcome`; `None` when the picture is done.
    pub(crate) fn next(&mut self, outcome: &Outcome) -> Option<Step> {
        match self.goal {
            Goal::AsSet => None,
            Goal::Error(error) => self.towards(error, outcome),
            Goal::Time { limit, error } => {
                if error.is_some_and(|e| outcome.error.rmse() <= e) || self.tolerance == Tolerance::MIN {
                    return None;
                }
                let left = limit.saturating_sub(outcome.now).as_secs_f64();
                if left <= 0.0 {
                    return None;
                }
                let times = (left * SHARE / outcome.took.as_secs_f64().max(1e-4)).max(1.0);
                let mut finer = libm::pow(times, 1.0 / TIME_POWER).clamp(1.5, 16.0);
                if let Some(e) = error {
                    // No finer than the error asked for needs.
                    finer = finer.min(libm::pow(outcome.error.rmse() / (AIM * e), 1.0 / ERROR_POWER).max(1.1));
                }
                let tolerance = Tolerance::new(self.tolerance.fraction() / finer);
                let mut tiles = outcome.tiles.clone();
                // Where most is to be gained first; the order of equals is that of the picture.
                let gain = |(r, e): &(Region, ErrorEstimate)| e.squares as f64 / r.area() as f64;
                tiles.sort_by(|a, b| gain(b).total_cmp(&gain(a)).then(a.0.cmp(&b.0)));
                Some(self.render(tolerance, tiles.into_iter().map(|(r, _)| r).collect()))
            }
        }
    }

    fn towards(&mut self, error: f64, outcome: &Outcome) -> Option<Step> {
        let got = outcome.error.rmse();
        let share = match (self.whole, self.looks < LOOKS.len()) {
            (0, false) => (1.0 - SURE - self.doubt(outcome)).max(LEAST_AIM),
            _ => AIM,
        };
        let aim = share * error;
        // Where a look met nothing of what is in the picture, it says little.
        let ratio = if got > 0.0 { (aim / got).clamp(0.02, COARSER) } else { 1.0 };
        let better = |power: f64, t: Tolerance| Tolerance::new(t.fraction() * libm::pow(ratio, power));
        if self.whole == 0 {
            let next = better(1.0 / ERROR_POWER, self.tolerance);
            if self.looks == LOOKS.len() || next == self.tolerance || self.spots().are_all() {
                return Some(self.render(next, Vec::new()));
            }
            self.tolerance = next;
            return Some(self.look());
        }
        // What was looked at was too easy: once more, finer.
        if got > error && self.whole < 3 && self.tolerance > Tolerance::MIN {
            let next = better(1.2 / ERROR_POWER, self.tolerance);
            return Some(self.render(next, Vec::new()));
        }
        None
    }

    /// Standard error of the root mean square that was seen at the spots, as a share of it. What lies between
    /// them differs from them as they do from their neighbours.
    fn doubt(&self, outcome: &Outcome) -> f64 {
        // A spot may have come in several tiles, and these in any order.
        let mut seen = BTreeMap::<(u32, u32), u64>::new();
        for (region, error) in &outcome.tiles {
            let spot = ((region.x0 - self.region.x0) / SPOT, (region.y0 - self.region.y0) / SPOT);
            let squares = seen.entry(spot).or_default();
            *squares = squares.saturating_add(error.squares);
        }
        let spots = self.spots();
        let at = |i: u32, j: u32| seen.get(&spots.block(i, j)).map_or(0.0, |&q| q as f64);
        let (mut apart, mut pairs, mut sum) = (0.0, 0.0, 0.0);
        for j in 0..spots.down {
            for i in 0..spots.across {
                let here = at(i, j);
                sum += here;
                for (other, inside) in [((i + 1, j), i + 1 < spots.across), ((i, j + 1), j + 1 < spots.down)] {
                    if inside {
                        let d = here - at(other.0, other.1);
                        (apart, pairs) = (apart + 0.5 * d * d, pairs + 1.0);
                    }
                }
            }
        }
        let n = f64::from(spots.across) * f64::from(spots.down);
        if !(sum > 0.0 && pairs > 0.0) {
            return 0.0;
        }
        let unseen = 1.0 - n / (f64::from(spots.wide) * f64::from(spots.high));
        // A root's relative error is half of what is beneath it.
        0.5 * (unseen.max(0.0) * n * apart / pairs).sqrt() / sum
    }

    /// Pixels of the picture.
    pub(crate) fn area(&self) -> u64 {
        self.region.area()
    }

    /// Whether tiles are to be remembered one by one.
    pub(crate) fn wants_tiles(&self) -> bool {
        match self.goal {
            Goal::AsSet => false,
            // Of looks.
            Goal::Error(_) => self.whole == 0,
            Goal::Time { .. } => true,
        }
    }

    /// When time is up, since the render began.
    pub(crate) fn limit(&self) -> Option<Duration> {
        match self.goal {
            Goal::Time { limit, .. } => Some(limit),
            _ => None,
        }
    }

    /// Renders for the picture.
    fn render(&mut self, tolerance: Tolerance, regions: Vec<Region>) -> Step {
        let dearer = libm::pow(self.tolerance.fraction() / tolerance.fraction(), TIME_POWER);
        self.tolerance = tolerance;
        self.whole += 1;
        Step { tolerance: Some(tolerance), regions, kept: true, dearer }
    }

    /// What the look at hand sees.
    fn spots(&self) -> Spots {
        let (one_in, least) = LOOKS[self.looks.clamp(1, LOOKS.len()) - 1];
        Spots::over(self.region, one_in, least)
    }

    /// Renders blocks spread over the picture, to see how errors depend on the tolerance.
    fn look(&mut self) -> Step {
        self.looks += 1;
        let regions = self.spots().regions().collect();
        Step { tolerance: Some(self.tolerance), regions, kept: false, dearer: 1.0 }
    }
}

/// Blocks of a picture of which one in every field of a grid is looked at.
#[derive(Clone, Copy, Debug)]
struct Spots {
    picture: Region,
    /// Blocks across and down.
    wide: u32,
    high: u32,
    /// Fields across and down.
    across: u32,
    down: u32,
}

impl Spots {
    /// One of about `one_in` blocks, and about `least` at least.
    fn over(picture: Region, one_in: f64, least: f64) -> Self {
        let (wide, high) = (picture.width().div_ceil(SPOT), picture.height().div_ceil(SPOT));
        let blocks = f64::from(wide) * f64::from(high);
        let count = (blocks / one_in).max(least).min(blocks);
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
    fn are_all(&self) -> bool {
        (self.across, self.down) == (self.wide, self.high)
    }

    fn regions(self) -> impl Iterator<Item = Region> {
        let all = (0..self.down).flat_map(move |j| (0..self.across).map(move |i| (i, j)));
        all.map(move |(i, j)| self.region(self.block(i, j)))
    }

    /// The block of field (i, j) that is looked at, by column and row.
    fn block(&self, i: u32, j: u32) -> (u32, u32) {
        // Fractional parts that fill a square evenly (Roberts, *The unreasonable effectiveness of quasirandom
        // sequences*, 2018).
        let k = u64::from(j) * u64::from(self.across) + u64::from(i);
        let pick = |k: u32, fields: u32, blocks: u32, part: u64| {
            let edge = |k: u32| (u64::from(k) * u64::from(blocks) / u64::from(fields)) as u32;
            let (from, to) = (edge(k), edge(k + 1));
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
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// What `step` gives of a picture in whose regions errors add up to `squares` in all.
    fn outcome(step: &Step, whole: Region, squares: impl Fn(&Region) -> f64) -> Outcome {
        let regions = if step.regions.is_empty() { vec![whole] } else { step.regions.clone() };
        let tiles: Vec<(Region, ErrorEstimate)> = regions
            .into_iter()
            .map(|r| {
                let squares = (squares(&r) * f64::from(1u32 << ErrorEstimate::SHIFT)) as u64;
                (r, ErrorEstimate { pixels: r.area(), squares, ..ErrorEstimate::default() })
            })
            .collect();
        let mut error = ErrorEstimate::default();
        tiles.iter().for_each(|(_, e)| error += *e);
        Outcome { error, tiles, ..Outcome::default() }
    }

    /// Of a picture whose error falls with a power of the tolerance, and never below `least`.
    fn picture(step: &Step, whole: Region, (scale, power, least): (f64, f64, f64)) -> Outcome {
        let tolerance = step.tolerance.map_or(0.0, Tolerance::fraction);
        let rmse = (scale * libm::pow(tolerance, power)).max(least);
        outcome(step, whole, |r| rmse * rmse * r.area() as f64)
    }

    fn region() -> Region {
        Region { x0: 0, y0: 0, x1: 640, y1: 480 }
    }

    #[test]
    fn errors_asked_for_are_met_and_not_by_far() {
        for (scale, power) in [(1.0, 0.85), (0.2, 0.6), (3.0, 1.1)] {
            for target in [4.0 / 255.0, 0.5 / 255.0, 0.1 / 255.0] {
                let mut plan = Plan::new(Goal::Error(target), region());
                let (mut step, mut passes, mut kept) = (plan.first(), 1, None);
                loop {
                    let outcome = picture(&step, region(), (scale, power, 0.0));
                    if step.kept {
                        kept = Some(outcome.error.rmse());
                    }
                    let Some(next) = plan.next(&outcome) else { break };
                    (step, passes) = (next, passes + 1);
                }
                let got = kept.expect("a picture");
                assert!(got <= 1.02 * target && got > target / 3.0, "{scale} {power}: {got} for {target}");
                assert!(passes <= 8, "{passes} passes");
            }
        }
    }

    /// Of a picture that errs in `part` alone, where errors are as the tolerance but never above `most`.
    fn speck(step: &Step, whole: Region, part: Region, most: f64) -> Outcome {
        let tolerance = step.tolerance.map_or(0.0, Tolerance::fraction).min(most);
        let overlap = |a0: u32, a1: u32, b0: u32, b1: u32| f64::from(a1.min(b1).saturating_sub(a0.max(b0)));
        outcome(step, whole, |r| {
            let pixels = overlap(r.x0, r.x1, part.x0, part.x1) * overlap(r.y0, r.y1, part.y0, part.y1);
            pixels * tolerance * tolerance
        })
    }

    #[test]
    fn what_no_look_meets_leads_nowhere_far() {
        let target = 0.5 / 255.0;
        for (x0, y0) in [(0, 0), (301, 203), (77, 400), (555, 31), (160, 120), (431, 333)] {
            let part = Region { x0, y0, x1: x0 + 32, y1: y0 + 24 };
            let mut plan = Plan::new(Goal::Error(target), region());
            let (mut step, mut got, mut whole) = (plan.first(), 1.0, 0);
            loop {
                let outcome = speck(&step, region(), part, 0.2);
                if step.kept {
                    (got, whole) = (outcome.error.rmse(), whole + 1);
                }
                let Some(next) = plan.next(&outcome) else { break };
                step = next;
            }
            assert!(got <= target && whole <= 2, "{x0},{y0}: {got}, {whole} times");
        }
    }

    #[test]
    fn the_more_spots_differ_from_their_neighbours_the_more_is_in_doubt() {
        let doubt = |squares: &dyn Fn(u32) -> u64| {
            let mut plan = Plan::new(Goal::Error(0.002), region());
            let step = plan.first();
            let of =
                |r: &Region| (*r, ErrorEstimate { pixels: r.area(), squares: squares(r.x0), ..Default::default() });
            let tiles: Vec<_> = step.regions.iter().map(of).collect();
            plan.doubt(&Outcome { tiles, ..Outcome::default() })
        };
        let ragged = |x: u32| u64::from((x / SPOT).wrapping_mul(0x9e37_79b9) >> 22);
        let (even, slope, ragged) = (doubt(&|_| 500), doubt(&|x| u64::from(x)), doubt(&ragged));
        assert_eq!(even, 0.0);
        assert!(0.0 < slope && 2.0 * slope < ragged && ragged < 0.5, "{slope}, {ragged}");
    }

    #[test]
    fn small_pictures_are_looked_at_once() {
        let small = Region { x0: 8, y0: 16, x1: 40, y1: 48 };
        let mut plan = Plan::new(Goal::Error(0.002), small);
        let step = plan.first();
        assert_eq!(step.regions.iter().map(Region::area).sum::<u64>(), small.area());
        assert!(plan.next(&picture(&step, small, (1.0, 0.6, 0.0))).expect("a picture").kept);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        #[test]
        fn spots_are_about_as_many_as_meant_and_in_the_picture(
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
            for (one_in, least) in LOOKS {
                let regions: Vec<Region> = Spots::over(picture, one_in, least).regions().collect();
                let count = (blocks / one_in).max(least).min(blocks);
                let some = regions.len() as f64;
                prop_assert!(some >= 0.99 * count && some <= 1.5 * count + 20.0, "{some} for {count}");
                let mut corners: Vec<_> = regions.iter().map(|r| (r.x0, r.y0)).collect();
                corners.sort_unstable();
                corners.dedup();
                prop_assert_eq!(corners.len(), regions.len());
                prop_assert!(regions.iter().all(|r| r.area() > 0 && picture.contains(r)));
            }
        }
    }

    #[test]
    fn what_cannot_be_met_ends() {
        let mut plan = Plan::new(Goal::Error(1e-6), region());
        let mut step = plan.first();
        for _ in 0..20 {
            match plan.next(&picture(&step, region(), (1.0, 0.85, 1e-3))) {
                Some(next) => step = next,
                None => return,
            }
        }
        panic!("no end");
    }

    #[test]
    fn under_a_time_limit_a_coarse_picture_comes_first_and_the_worst_is_refined_first() {
        let limit = Duration::from_secs(10);
        let mut plan = Plan::new(Goal::Time { limit, error: None }, region());
        let first = plan.first();
        assert!(first.kept && first.regions.is_empty());
        let tile = |x0| Region { x0, y0: 0, x1: x0 + 32, y1: 32 };
        let of = |squares| ErrorEstimate { pixels: 1024, squares, ..ErrorEstimate::default() };
        let tiles = vec![(tile(0), of(10)), (tile(32), of(1000)), (tile(64), of(100))];
        let outcome =
            Outcome { error: of(1110), tiles, took: Duration::from_millis(100), now: Duration::from_millis(200) };
        let next = plan.next(&outcome).expect("there is time");
        assert_eq!(next.regions, [tile(32), tile(64), tile(0)]);
        assert!(next.tolerance < first.tolerance);
        assert!(plan.next(&Outcome { now: limit, ..outcome }).is_none());
    }

    #[test]
    fn an_error_reached_before_the_time_is_up_is_enough() {
        let mut plan = Plan::new(Goal::Time { limit: Duration::from_secs(10), error: Some(0.01) }, region());
        let step = plan.first();
        assert!(plan.next(&picture(&step, region(), (0.1, 0.85, 0.0))).is_none());
    }
}
