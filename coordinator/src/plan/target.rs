//! Passes towards an error.
//!
//! ```text
//! look at few blocks ─▶ render ─▶ met: done
//!    ▲  │ not as expected,  ▲  │ missed, and finer helps
//!    └──┘ or far off        └──┘
//! ```
//! A look sees what was expected where the audit agrees with the sampler; further ones see more blocks.
//! Looks are spread over the whole view, whatever region of it is rendered, so that regions are rendered within the
//! tolerance that the whole is. A picture so small that a look sees all of it needs no other render: then looks go on
//! until one meets the target and not by far, and its pixels are the picture.

use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::settings::{AuditRate, Detail, Pass, Tolerance};

use super::cost;
use super::look::{ExpectedPoints, Spots};
use super::model::MODEL;
use super::{Outcome, Step, reaches, within};

/// Looks at most: at parts, and at all of a small picture.
const LOOKS: usize = 4;
const LOOKS_AT_ALL: usize = 8;
/// Renders at most.
const RENDERS: u32 = 4;

/// See the [module](self).
#[derive(Debug)]
pub(crate) struct Target {
    error: f64,
    view: Region,
    region: Region,
    /// Of the pass at hand.
    tolerance: Tolerance,
    audit: AuditRate,
    /// What the last pass saw, and how much of it was audited.
    seen: Option<(ErrorEstimate, AuditRate)>,
    looks: usize,
    renders: u32,
    /// The loosest tolerance known to meet the target, and the tightest known not to.
    good: Option<Tolerance>,
    bad: Option<Tolerance>,
    /// How many times as much of a render is audited as its cost would have it.
    closer: u32,
    /// The last tolerance that missed it, and the upper end of the error then.
    missed: Option<(Tolerance, f64)>,
    /// Whether the whole view meets the target by what was seen.
    met: bool,
    /// Points that are expected where, and seconds a point, by the last look at parts.
    expected: Option<(ExpectedPoints, f64)>,
}

/// What a pass tells of the whole.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    rmse: f64,
    /// What the sampler expected.
    expected: f64,
    /// The ends of its interval.
    lower: f64,
    upper: f64,
    /// By how much a render's error may be above what is aimed at.
    margin: f64,
}

impl Estimate {
    /// Whether the audit agrees with the sampler.
    fn is_expected(&self) -> bool {
        self.lower < (1.0 + MODEL.expected_off) * self.expected
            && self.expected < (1.0 + MODEL.expected_off) * self.upper
    }

    /// The error of the whole: between what the audit found and what was expected, by how sure either is.
    fn likely(&self) -> f64 {
        let found = self.rmse.clamp(MODEL.surprise[0] * self.expected, MODEL.surprise[1] * self.expected);
        if !(self.rmse > 0.0 && self.expected > 0.0) {
            return found;
        }
        let off = 0.5 * (self.upper / self.rmse - 1.0);
        let known = MODEL.expected_off * MODEL.expected_off;
        let share = known / (known + off * off);
        libm::pow(found, share) * libm::pow(self.expected, 1.0 - share)
    }
}

impl Target {
    pub(super) fn new(error: f64, view: Region, region: Region) -> Self {
        Self {
            error,
            view,
            region,
            tolerance: clamped(MODEL.guess * error),
            audit: MODEL.look_rate,
            seen: None,
            looks: 0,
            renders: 0,
            good: None,
            bad: None,
            closer: 1,
            missed: None,
            met: false,
            expected: None,
        }
    }

    pub(super) fn first(&mut self) -> Step {
        self.look(self.tolerance)
    }

    /// Whether the pass at hand is a look.
    pub(super) fn is_looking(&self) -> bool {
        self.renders == 0
    }

    pub(super) fn is_met(&self, error: &ErrorEstimate) -> bool {
        if self.is_whole() { reaches(error, self.error) } else { self.met || reaches(error, self.error) }
    }

    pub(super) fn next(&mut self, outcome: &Outcome) -> Option<Step> {
        if self.renders > 0 {
            return self.after_render(outcome);
        }
        let spots = self.spots();
        let error = outcome.error;
        let (rmse, (lower, upper)) = (error.rmse(), error.interval());
        self.seen = Some((error, self.audit));
        // The render's audit draws other pixels, and more or fewer of them.
        let (_, drawn) = cost::audit(self.view.area(), self.seen.as_ref().map(|(e, rate)| (e, *rate)));
        let audits =
            if spots.are_all() { 1.0 } else { (error.audited as f64 / drawn.max(1.0)).sqrt().max(MODEL.narrows) };
        let expected = error.expected_rmse();
        // What errors were found may be few of those that there are.
        let spread = if rmse > 0.0 { (upper / rmse.max(expected.min(upper)) - 1.0) * audits } else { 0.0 };
        let fields = spots.fields(&outcome.tiles);
        let doubt = fields.doubt();
        if !spots.are_all() {
            let points = error.pixels as f64 * MODEL.audited_look * cost::points(&error, self.tolerance);
            let seconds = outcome.took.as_secs_f64() / points.max(1.0);
            self.expected = Some((fields.expected_points(|e| cost::points(e, self.tolerance)), seconds));
        }
        let estimate = Estimate { rmse, expected, lower, upper, margin: (1.0 + spread) * (1.0 + 1.2 * doubt) };
        if spots.are_all() { self.after_all(estimate) } else { self.after_look(estimate) }
    }

    /// The tolerance that leads from what was seen to what is aimed at, and by what factor the error changes.
    fn better(&self, estimate: &Estimate) -> (Tolerance, f64) {
        let all = self.spots().are_all();
        let least = if all { MODEL.least_aim_at_all } else { MODEL.least_aim };
        let aim = (MODEL.sure / estimate.margin).clamp(least, MODEL.most_aim) * self.error;
        let rmse = if all {
            // Where nothing was seen to err, the upper end says how little that tells.
            if estimate.rmse > 0.0 { estimate.rmse } else { 0.5 * estimate.upper }
        } else {
            estimate.likely()
        };
        let ratio = if rmse > 0.0 { aim / rmse } else { MODEL.steps[1] };
        (self.scaled(ratio), ratio)
    }

    /// The tolerance at hand, such that the error changes by a factor.
    fn scaled(&self, ratio: f64) -> Tolerance {
        clamped(
            self.tolerance.fraction() * libm::pow(ratio.clamp(MODEL.steps[0], MODEL.steps[1]), 1.0 / MODEL.error_power),
        )
    }

    /// After a look at parts.
    fn after_look(&mut self, estimate: Estimate) -> Option<Step> {
        let (next, ratio) = self.better(&estimate);
        let near = (self.looks > 1 || estimate.is_expected()) && (MODEL.near[0]..MODEL.near[1]).contains(&ratio);
        if near || self.looks >= LOOKS || next == self.tolerance {
            let expected = estimate.likely() * next.fraction() / self.tolerance.fraction();
            self.met = expected * estimate.margin <= self.error;
            return Some(self.render(next));
        }
        Some(self.look(next))
    }

    /// After a look at all of a small picture.
    fn after_all(&mut self, estimate: Estimate) -> Option<Step> {
        let now = self.tolerance;
        if estimate.upper <= self.error {
            self.good = Some(self.good.map_or(now, |t| t.max(now)));
            if estimate.rmse >= MODEL.too_good * self.error || now == clamped(MODEL.loosest) {
                return self.settle(now);
            }
        } else {
            self.bad = Some(self.bad.map_or(now, |t| t.min(now)));
            if self.is_in_vain(estimate.upper) {
                return self.settle(self.good.unwrap_or(now));
            }
        }
        let (mut next, _) = self.better(&estimate);
        if let (Some(good), Some(bad)) = (self.good, self.bad)
            && !(good < next && next < bad)
        {
            next = Tolerance::new((good.fraction() * bad.fraction()).sqrt());
            if bad.fraction() < 1.1 * good.fraction() {
                return self.settle(good);
            }
        }
        if self.looks >= LOOKS_AT_ALL || next == now {
            return self.settle(self.good.unwrap_or(now));
        }
        Some(self.look(next))
    }

    /// After a render of the region.
    fn after_render(&mut self, outcome: &Outcome) -> Option<Step> {
        // What a part errs by says nothing of the whole.
        if !self.is_whole() {
            return None;
        }
        let upper = outcome.error.interval().1;
        let in_vain = self.is_in_vain(upper);
        // What was found meets the target, only not surely: then more of the picture is audited. The pixels that were
        // drawn before are drawn again, so that finer ones alone would leave a few that stand out as they were.
        let unsure = outcome.error.rmse() <= self.error && self.audit != AuditRate::ALL;
        let over = reaches(&outcome.error, self.error) || self.spots().are_all() || (in_vain && !unsure);
        if over || self.renders >= RENDERS || self.tolerance == Tolerance::MIN {
            return None;
        }
        if unsure {
            self.closer = self.closer.saturating_mul(MODEL.closer);
        }
        self.seen = Some((outcome.error, self.audit));
        let next = self.scaled((MODEL.once_more * self.error / upper).min(MODEL.once_more));
        Some(self.render(next))
    }

    /// Whether looking closer has not helped: notes that the tolerance at hand missed the target.
    fn is_in_vain(&mut self, upper: f64) -> bool {
        let before = self.missed.replace((self.tolerance, upper));
        before.is_some_and(|(t, u)| {
            let finer = self.tolerance.fraction() / t.fraction();
            finer < 0.85 && upper > u * (1.0 - MODEL.helps * (1.0 - finer))
        })
    }

    /// Expected work in `region`, in units of its own.
    pub(super) fn work(&self, region: &Region) -> f64 {
        match &self.expected {
            Some((expected, _)) if self.renders > 0 => expected.of(region),
            _ => region.area() as f64,
        }
    }

    /// How long the render at hand is expected to take.
    pub(super) fn expected(&self) -> Option<Duration> {
        let (points, seconds) = self.expected.as_ref().filter(|_| self.renders == 1)?;
        Duration::try_from_secs_f64(1.1 * seconds * points.of(&self.region)).ok()
    }

    fn is_whole(&self) -> bool {
        self.region == self.view
    }

    /// What the look at hand sees.
    fn spots(&self) -> Spots {
        Spots::of(self.view, self.looks.max(1) - 1)
    }

    /// Ends with a tolerance whose error over all of the view is known.
    fn settle(&mut self, tolerance: Tolerance) -> Option<Step> {
        self.met = self.good.is_some_and(|good| tolerance <= good);
        if self.is_whole() && tolerance == self.tolerance { None } else { Some(self.render(tolerance)) }
    }

    /// Renders for the picture.
    fn render(&mut self, tolerance: Tolerance) -> Step {
        let seen = self.seen.as_ref().map(|(e, t)| (e, *t));
        let (audit, _) = if self.is_whole() && self.spots().are_all() {
            (AuditRate::ALL, 0.0)
        } else {
            cost::audit(self.region.area(), seen)
        };
        let audit = AuditRate(audit.0.saturating_mul(self.closer));
        // A look's pixels are audited.
        let audited = if self.renders == 0 { MODEL.audited_look } else { 1.0 };
        let dearer = self.tolerance.fraction() / tolerance.fraction() / audited;
        self.tolerance = tolerance;
        self.audit = audit;
        self.renders += 1;
        Step { pass: within(tolerance, audit), regions: Vec::new(), kept: true, dearer }
    }

    /// Renders blocks spread over the view, to see how errors depend on the tolerance.
    fn look(&mut self, tolerance: Tolerance) -> Step {
        let dearer = self.tolerance.fraction() / tolerance.fraction();
        self.tolerance = tolerance;
        self.looks += 1;
        let spots = self.spots();
        let (detail, audit) = if spots.are_all() {
            (Detail::Within(tolerance), AuditRate::ALL)
        } else {
            (Detail::Glance(tolerance), MODEL.look_rate)
        };
        self.audit = audit;
        let kept = spots.are_all() && self.is_whole();
        let regions = if kept { Vec::new() } else { spots.regions().collect() };
        Step { pass: Some(Pass { detail, audit }), regions, kept, dearer }
    }
}

/// The tolerance nearest to `fraction` that makes sense.
fn clamped(fraction: f64) -> Tolerance {
    Tolerance::new(fraction.min(MODEL.loosest))
}
