//! The passes over a picture: what the plan asks for, what an earlier run left of it, and what came.

use std::collections::BTreeMap;
use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region, Sum};
use tessera_core::settings::{Detail, Pass};
use tessera_core::trace::RayCounts;
use tessera_proto::convert::{Lease, TileDone};
use tessera_proto::{Attempt, LeaseId, PassNumber};
use tokio::time::Instant;

use crate::job::TileSize;
use crate::journal::{Kept, KeptPass, Place, Sink, rest};
use crate::plan::{Forecast, Outcome, Plan, Step};

/// Regions that a pass may be cut into where a part of it is done already.
const CUTS: u64 = 1 << 20;

/// A tile of an earlier run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Again {
    pub(super) region: Region,
    pub(super) place: Place,
    /// Whether the picture had nothing in this place before.
    pub(super) first: bool,
}

/// What comes next.
#[derive(Debug, Default)]
pub(super) struct Turn {
    /// Tiles of an earlier run that belong into the picture, in order and before all that comes.
    pub(super) again: Vec<Again>,
    /// What is to be rendered; `None` when the picture is done.
    pub(super) step: Option<Step>,
    /// Of all passes that this turn went through.
    pub(super) rays: RayCounts,
    pub(super) tiles: u64,
    /// Of the pass to be rendered: done already, and in all.
    pub(super) tiles_done: u64,
    pub(super) pixels_done: u64,
    pub(super) pixels: u64,
    /// What is to be rendered, in the plan's measure.
    pub(super) work: f64,
}

/// How long a picture has been rendered for, earlier runs counted in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub(super) start: Instant,
    /// Before the start of this run.
    pub(super) before: Duration,
}

impl Clock {
    fn now(&self) -> Duration {
        self.before + self.start.elapsed()
    }
}

/// See the [module](self).
pub(super) struct Passes {
    plan: Plan,
    region: Region,
    tile: TileSize,
    clock: Clock,
    left: BTreeMap<u32, KeptPass>,
    sink: Option<Sink>,
    /// The pass at hand.
    at_hand: Outcome,
    began: Duration,
    kept: bool,
    detail: Option<Pass>,
    /// Of the last whole picture.
    picture: Outcome,
    whole: u32,
    /// Passes begun.
    pub(super) begun: u32,
    /// How closely the last whole picture was looked at; before there is one, the picture at hand.
    pub(super) pass: Option<Pass>,
    /// Whether time was up before the plan was done.
    pub(super) timed_out: bool,
}

impl Passes {
    /// Towards what `plan` aims at, over `region`. What an earlier run left need not be rendered again, and what
    /// comes goes into `sink`.
    pub(super) fn new(
        plan: Plan,
        (region, tile): (Region, TileSize),
        clock: Clock,
        left: BTreeMap<u32, KeptPass>,
        sink: Option<Sink>,
    ) -> Self {
        Self {
            plan,
            region,
            tile,
            clock,
            left,
            sink,
            at_hand: Outcome::default(),
            began: Duration::ZERO,
            kept: false,
            detail: None,
            picture: Outcome::default(),
            whole: 0,
            begun: 0,
            pass: None,
            timed_out: false,
        }
    }

    /// When time is up.
    pub(super) fn deadline(&self) -> Option<Instant> {
        let limit = self.plan.limit()?;
        Some(self.clock.start + limit.saturating_sub(self.clock.before))
    }

    /// The beginning.
    pub(super) fn first(&mut self) -> Turn {
        let first = self.plan.first();
        self.turn(Some(first))
    }

    /// What comes after the pass at hand, which is done.
    pub(super) fn passed(&mut self) -> Turn {
        let next = self.end(None);
        self.turn(next)
    }

    /// Goes through passes that are there as a whole, up to one that is not.
    fn turn(&mut self, mut next: Option<Step>) -> Turn {
        let mut turn = Turn::default();
        while let Some(mut step) = next {
            let ended = self.begin(&mut step, &mut turn);
            if !step.regions.is_empty() || turn.pixels_done == 0 {
                turn.work = match &step.regions[..] {
                    [] => self.plan.work(&self.region),
                    regions => regions.iter().map(|r| self.plan.work(r)).sum(),
                };
                turn.step = Some(step);
                break;
            }
            next = self.end(ended);
        }
        turn
    }

    /// Begins a pass, and leaves in `step` what is to be rendered of it: nothing where that is no region and pixels
    /// are done. Gives how long it took and when it ended, if that is known.
    fn begin(&mut self, step: &mut Step, turn: &mut Turn) -> Option<(Duration, Duration)> {
        let number = self.begun;
        self.begun += 1;
        self.kept = step.kept;
        self.began = self.clock.now();
        self.detail = step.pass;
        self.at_hand = Outcome::default();
        if self.whole == 0 && step.kept {
            self.pass = step.pass;
        }
        turn.pixels = step.regions.iter().map(Region::area).sum();
        if step.regions.is_empty() {
            turn.pixels = self.region.area();
        }
        (turn.tiles_done, turn.pixels_done) = (0, 0);
        let KeptPass { mut tiles, ended } = self.left.remove(&number)?;
        let asked = |t: &Kept| self.lease(t.lease.region);
        tiles.retain(|t| t.lease == asked(t));
        let done: Vec<Region> = tiles.iter().map(|t| t.lease.region).collect();
        if done.is_empty() {
            return None;
        }
        let cells = || self.region.blocks(self.edge());
        let regions = if step.regions.is_empty() { cells() } else { std::mem::take(&mut step.regions) };
        let Some(left) = rest(&regions, &done) else {
            tracing::warn!("pass {} is rendered again: its tiles in the journal do not fit together", number + 1);
            step.regions = regions;
            return None;
        };
        step.regions = left;
        for tile in tiles {
            let region = tile.lease.region;
            turn.tiles_done += 1;
            turn.pixels_done += region.area();
            turn.rays += tile.rays;
            self.account(region, tile.error);
            if self.kept {
                turn.again.push(Again { region, place: tile.place, first: self.whole == 0 });
            }
        }
        turn.tiles += turn.tiles_done;
        ended
    }

    /// The edge of what is leased of a pass of which a part is done.
    fn edge(&self) -> u32 {
        let wanted = match self.tile {
            TileSize::Auto => TileSize::MAX_EDGE,
            TileSize::Edge(n) => n.clamp(1, TileSize::MAX_EDGE),
        };
        let cells = |edge: u32| self.region.area().div_ceil(u64::from(edge) * u64::from(edge));
        // Tiles change no pixel: a list of billions is not worth keeping to them.
        if cells(wanted) > CUTS { TileSize::MAX_EDGE } else { wanted }
    }

    /// How `region` is rendered in the pass at hand.
    fn lease(&self, region: Region) -> Lease {
        let number = PassNumber(self.begun.saturating_sub(1));
        Lease { id: LeaseId(0), attempt: Attempt(0), region, number, pass: self.detail }
    }

    fn account(&mut self, region: Region, error: ErrorEstimate) {
        self.at_hand.error += error;
        if self.plan.wants_tiles() {
            self.at_hand.tiles.push((region, error));
        }
    }

    /// Takes in a tile. Gives whether it belongs into the picture, and then whether nothing was in its place.
    pub(super) fn accept(&mut self, region: Region, done: &TileDone, worker: String) -> Option<bool> {
        self.account(region, done.error);
        let (lease, now) = (self.lease(region), self.clock.now());
        if let Some(sink) = &mut self.sink {
            sink.tile(lease, done, self.kept, (worker, now));
        }
        self.kept.then_some(self.whole == 0)
    }

    /// Forgets `regions` of the pass at hand, which are to be rendered again: `rest` is the error of the others.
    /// Nothing takes them out of a sink: there is none where tiles may be taken back.
    pub(super) fn take_back(&mut self, regions: &[Region], rest: ErrorEstimate) {
        self.at_hand.tiles.retain(|(region, _)| !regions.contains(region));
        self.at_hand.error = rest;
    }

    /// How closely the pass at hand looks.
    pub(super) fn detail(&self) -> Option<Pass> {
        self.detail
    }

    /// Whether the pass at hand goes into the picture.
    pub(super) fn is_kept(&self) -> bool {
        self.kept
    }

    /// Ends a pass, of which may be known how long it took and when it ended; else it ends now. Gives the one after
    /// it, if there is one.
    fn end(&mut self, known: Option<(Duration, Duration)>) -> Option<Step> {
        let now = self.clock.now();
        let (took, now) = known.unwrap_or((now.saturating_sub(self.began), now));
        let mut outcome = std::mem::take(&mut self.at_hand);
        (outcome.took, outcome.now) = (took, now);
        tracing::info!(
            pass = self.begun,
            kept = self.kept,
            pixels = outcome.error.pixels,
            detail = ?self.detail.map(|p| p.detail),
            audited = outcome.error.audited,
            steps = 255.0 * outcome.error.rmse(),
            up_to = 255.0 * outcome.error.interval().1,
            expected = 255.0 * outcome.error.expected_rmse(),
            seconds = outcome.took.as_secs_f64(),
            "pass done"
        );
        let next = self.plan.next(&outcome);
        if self.kept {
            self.whole += 1;
            self.picture = outcome;
            self.pass = self.detail;
        }
        self.timed_out = self.plan.limit().is_some_and(|limit| limit <= now);
        if known.is_none()
            && let Some(sink) = &mut self.sink
        {
            sink.passed(self.begun - 1, took, now);
        }
        next
    }

    /// The estimate of the picture as it is: what the pass at hand has not replaced is as it was before.
    pub(super) fn error(&self) -> ErrorEstimate {
        let (old, new) = (&self.picture, &self.at_hand);
        if !self.kept || new.error.pixels == 0 || old.error.pixels <= new.error.pixels {
            return if self.whole > 0 { old.error } else { new.error };
        }
        let mut sum = new.error;
        for (region, error) in &old.tiles {
            let covered: u64 = new.tiles.iter().map(|(r, _)| common(r, region)).sum();
            let left = region.area() - covered.min(region.area());
            if left > 0 {
                let part = left as f64 / region.area() as f64;
                let share = |sum: Sum| Sum::new(part * sum.value());
                sum += ErrorEstimate {
                    pixels: left,
                    expected: share(error.expected),
                    audited: (part * error.audited as f64).round() as u64,
                    squares: share(error.squares),
                    variance: share(error.variance),
                };
            }
        }
        sum
    }

    /// What other errors would take, where the last whole picture tells.
    pub(super) fn forecast(&self) -> Option<Forecast> {
        match self.pass?.detail {
            Detail::Within(tolerance) if self.whole > 0 => {
                Some(Forecast::new(&self.picture.error, tolerance, self.picture.took))
            }
            _ => None,
        }
    }

    /// Whether there is a whole picture.
    pub(super) fn is_whole(&self) -> bool {
        self.whole > 0
    }

    /// The number of the pass at hand, from 1, and whether it only looks.
    pub(super) fn at_hand(&self) -> (u32, bool) {
        (self.begun, !self.kept)
    }

    /// As the plan has it.
    pub(super) fn limit(&self) -> Option<Duration> {
        self.plan.limit()
    }

    /// As the plan has it.
    pub(super) fn expected(&self) -> Option<Duration> {
        self.plan.expected()
    }

    /// As the plan has it.
    pub(super) fn work(&self, region: &Region) -> f64 {
        self.plan.work(region)
    }

    /// As the plan has it.
    pub(super) fn is_met(&self, error: &ErrorEstimate) -> Option<bool> {
        self.plan.is_met(error)
    }
}

/// Pixels that two regions share.
fn common(a: &Region, b: &Region) -> u64 {
    let overlap = |a0: u32, a1: u32, b0: u32, b1: u32| u64::from(a1.min(b1).saturating_sub(a0.max(b0)));
    overlap(a.x0, a.x1, b.x0, b.x1) * overlap(a.y0, a.y1, b.y0, b.y1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::plan::Goal;

    const WHOLE: Region = Region { x0: 3, y0: 4, x1: 203, y1: 154 };

    /// A pixel's expected squared error: more in some parts of the picture, and the less the finer the tolerance.
    fn error(region: &Region, pass: Option<Pass>) -> ErrorEstimate {
        let fine = match pass.map(|p| p.detail) {
            Some(Detail::Within(tolerance)) => tolerance.fraction(),
            _ => 1.0,
        };
        let square = |x: u32, y: u32| f64::from((x / 16 * 7 + y / 16 * 13) % 11) * fine * fine;
        let rows = (region.y0..region.y1).flat_map(|y| (region.x0..region.x1).map(move |x| (x, y)));
        let mut error = ErrorEstimate::default();
        for (x, y) in rows {
            error.add(square(x, y));
            error.audit(square(x, y), 0.0, 1.0);
        }
        error
    }

    /// What a render was, to be compared.
    #[derive(Debug, PartialEq)]
    struct End {
        passes: u32,
        pass: Option<Pass>,
        error: ErrorEstimate,
    }

    /// Renders towards `goal` from what is left of an earlier run, in tiles of `edge`, no more than `most` of them.
    /// Gives what there is to go on from, the pixels rendered, and the end if it came to that.
    fn run(goal: Goal, left: &[(u32, Kept)], edge: u32, most: usize) -> (Vec<(u32, Kept)>, u64, Option<End>) {
        let mut by_pass = BTreeMap::<u32, KeptPass>::new();
        for (pass, kept) in left {
            by_pass.entry(*pass).or_default().tiles.push(kept.clone());
        }
        let clock = Clock { start: Instant::now(), before: Duration::ZERO };
        let tile = TileSize::Edge(edge);
        let mut passes = Passes::new(Plan::new(goal, WHOLE, WHOLE), (WHOLE, tile), clock, by_pass, None);
        let (mut all, mut rendered) = (left.to_vec(), 0);
        let mut turn = passes.first();
        while let Some(step) = turn.step {
            let regions = if step.regions.is_empty() { vec![WHOLE] } else { step.regions };
            for region in regions.iter().flat_map(|r| r.blocks(edge)) {
                if all.len() - left.len() == most {
                    return (all, rendered, None);
                }
                let (lease, error) = (passes.lease(region), error(&region, step.pass));
                let done = TileDone {
                    lease: lease.id,
                    attempt: lease.attempt,
                    pixels: bytes::Bytes::new(),
                    error,
                    rays: RayCounts::default(),
                    busy: Duration::ZERO,
                    idle: Duration::ZERO,
                };
                passes.accept(region, &done, String::new());
                let kept = Kept { lease, error, rays: done.rays, place: Place::default() };
                all.push((passes.begun - 1, kept));
                rendered += region.area();
            }
            turn = passes.passed();
        }
        let end = End { passes: passes.begun, pass: passes.pass, error: passes.error() };
        (all, rendered, Some(end))
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

        /// Ended anywhere, any number of times, a render comes to the same end, and nothing is rendered twice.
        #[test]
        fn a_render_that_is_gone_on_with_is_the_quiet_one(
            edges in prop::collection::vec(5u32..80, 1..5), most in 1usize..60,
            target in prop::option::of(0.2f64..4.0),
        ) {
            let goal = target.map_or(Goal::AsSet, |steps| Goal::Error(steps / 255.0));
            let (_, once, quiet) = run(goal, &[], edges[0], usize::MAX);
            let (mut left, mut sum, mut end) = (Vec::new(), 0, None);
            for edge in edges.iter().cycle() {
                let (all, rendered, ended) = run(goal, &left, *edge, most);
                (left, sum) = (all, sum + rendered);
                if ended.is_some() {
                    end = ended;
                    break;
                }
            }
            prop_assert_eq!(end, quiet);
            prop_assert_eq!(sum, once);
        }
    }

    #[test]
    fn tiles_that_were_rendered_otherwise_or_overlap_are_not_taken() {
        let goal = Goal::AsSet;
        let (all, ..) = run(goal, &[], 50, 3);
        let mut other = all.clone();
        other.iter_mut().for_each(|(_, kept)| kept.lease.number = PassNumber(7));
        assert_eq!(run(goal, &other, 50, usize::MAX).1, WHOLE.area());
        let twice = [&all[..], &all[..1]].concat();
        assert_eq!(run(goal, &twice, 50, usize::MAX).1, WHOLE.area());
        assert!(run(goal, &all, 50, usize::MAX).1 < WHOLE.area());
    }
}
