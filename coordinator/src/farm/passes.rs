//! The passes over a picture: what the plan asks for, what an earlier run left of it, and what came.

use std::collections::BTreeMap;
use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region, Sum};
use tessera_core::settings::{Detail, Pass};
use tessera_core::trace::RayCounts;
use tessera_proto::convert::{Lease, TileDone};
use tessera_proto::identity::WorkerId;
use tessera_proto::{Attempt, LeaseId, PassNumber};
use tokio::time::Instant;

use crate::config::TileSize;
use crate::journal::{Delivery, Kept, KeptPass, Location, Sink, ThrownOut, rest};
use crate::plan::{Forecast, Outcome, Plan, Step};
use crate::progress::CheckedTile;

/// Regions that a pass may be cut into where a part of it is done already.
const CUTS: u64 = 1 << 20;

/// A tile of an earlier run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Again {
    pub(super) region: Region,
    pub(super) place: Location,
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
    /// Whether all of it was rendered by an earlier run, and only has to be verified.
    pub(super) nothing_left: bool,
    /// Tiles of an earlier run, where they are verified: of the pass to be rendered, and of the last one that is in
    /// the picture, if this turn went through it.
    pub(super) made: Vec<Kept>,
    pub(super) made_before: Option<Vec<Kept>>,
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
    /// Whether tiles are verified: a pass does not end with its last tile.
    held: bool,
    /// Whether parts of the picture were taken out, and are not yet in it again.
    holed: bool,
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
            held: false,
            holed: false,
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

    /// Ends no pass of an earlier run whose tiles may still have to be verified.
    pub(super) fn hold(&mut self) {
        self.held = true;
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
            let is_done = step.regions.is_empty() && turn.pixels_done > 0;
            if !is_done || (self.held && ended.is_none()) {
                turn.work = match &step.regions[..] {
                    [] if is_done => 0.0,
                    [] => self.plan.work(&self.region),
                    regions => regions.iter().map(|r| self.plan.work(r)).sum(),
                };
                (turn.step, turn.nothing_left) = (Some(step), is_done);
                break;
            }
            if self.kept {
                turn.made_before = Some(std::mem::take(&mut turn.made));
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
        turn.made.clear();
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
        if self.held {
            turn.made.clone_from(&tiles);
        }
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
    pub(super) fn accept(
        &mut self,
        region: Region,
        done: &TileDone,
        (name, made): (String, Option<(WorkerId, [u8; 32])>),
    ) -> Option<bool> {
        self.account(region, done.error);
        let (lease, at) = (self.lease(region), self.clock.now());
        if let Some(sink) = &mut self.sink {
            sink.tile(lease, done, self.kept, Delivery { name, at, made });
        }
        self.kept.then_some(self.whole == 0)
    }

    /// A tile of the pass at hand was rendered a second time.
    pub(super) fn checked(&mut self, check: &CheckedTile, confirmed: bool) {
        if let Some(sink) = &mut self.sink {
            sink.checked(self.begun.saturating_sub(1), check, confirmed);
        }
    }

    /// Forgets what a liar made: `regions` of the pass at hand are to be rendered again, and `rest` is the error of the
    /// others. The picture has holes until the end of this pass, where `holed`.
    pub(super) fn take_back(&mut self, out: &ThrownOut, regions: &[Region], rest: ErrorEstimate, holed: bool) {
        if let Some(sink) = &mut self.sink {
            sink.thrown_out(out);
        }
        self.holed |= holed;
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
            self.holed = false;
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

    /// The estimate of the last whole picture, or, before there is one, of its part that is done; as a fraction of
    /// full scale.
    pub(super) fn error_so_far(&self) -> Option<f64> {
        let error = match self.whole {
            0 if self.kept => self.at_hand.error,
            0 => return None,
            _ => self.picture.error,
        };
        (error.pixels > 0).then(|| error.rmse())
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
        self.whole > 0 && !self.holed
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
mod tests;
