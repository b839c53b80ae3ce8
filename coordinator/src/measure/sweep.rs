//! Which settings are rendered, in which order, and what each is expected to cost.

use std::time::Duration;

use tessera_core::settings::Quality;

use super::knob::Knob;
use super::peer::{self, Rung};
use super::point::Point;
use super::reference;

/// The share of a budget that a reference may take.
const REFERENCE_SHARE: f64 = 0.5;
/// Samples a pixel that a reference has at least, unless there is no time.
pub(super) const REFERENCE_SAMPLES: u32 = 256;
/// A reference is to be so many times as accurate as the target.
const REFERENCE_BETTER: f64 = 5.0;
/// The finest grid that a reference takes by itself.
const REFERENCE_GRID: u32 = 31;

/// One setting, to be rendered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    Ours(Knob),
    PovRay(Rung),
}

impl Step {
    /// What people call it.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Ours(knob) => knob.flags().join(" "),
            Self::PovRay(rung) => format!("POV-Ray {}", rung.value()),
        }
    }

    fn rough_cost(&self) -> f64 {
        match self {
            Self::Ours(knob) => rough_cost(knob),
            Self::PovRay(rung) => rung.cost,
        }
    }
}

/// Every setting that is worth a try, those expected to be cheap first: whatever ends the sweep
/// early, the most has been learnt by then.
/// `shorter`: paths are tried that are shorter than so many rays, at that quality.
pub(super) fn steps(target: f64, shorter: Option<(u32, Quality)>, peers: bool) -> Vec<Step> {
    // A quality is an error by another name.
    let named = |steps: f64| Quality::ALL.iter().any(|q| (255.0 * q.rmse() / steps - 1.0).abs() < 1e-6);
    let errors = [8.0, 4.0, 2.0, 1.0, 0.5, 0.25].map(|times| times * target);
    let mut knobs: Vec<Knob> = errors.into_iter().filter(|&e| !named(e)).map(Knob::MaxError).collect();
    knobs.extend(Quality::ALL.map(Knob::Quality));
    knobs.extend([1, 2, 3, 4, 5, 6, 8, 10, 12, 16].into_iter().flat_map(|n| [Knob::Samples(n), Knob::Scrambled(n)]));
    if let Some((max_depth, quality)) = shorter {
        let depths = [1, 2, 3, 4, 6, 8, 12].into_iter().filter(|&d| d < max_depth);
        knobs.extend(depths.map(|depth| Knob::MaxDepth(depth, quality)));
    }
    let mut steps: Vec<Step> = knobs.into_iter().map(Step::Ours).collect();
    if peers {
        steps.extend(peer::LADDER.map(Step::PovRay));
    }
    steps.sort_by(|a, b| a.rough_cost().total_cmp(&b.rough_cost()));
    steps
}

/// What a setting costs on a scene of middling difficulty, in renders of one sample a pixel.
fn rough_cost(knob: &Knob) -> f64 {
    // Time rises with the inverse of the error to about this power.
    let adaptive = |steps: f64| (6.0 * libm::pow(0.5 / steps, 0.7)).max(1.5);
    match *knob {
        Knob::MaxError(steps) => adaptive(steps),
        Knob::Quality(quality) => adaptive(255.0 * quality.rmse()),
        Knob::Samples(grid) | Knob::Scrambled(grid) => f64::from(grid * grid),
        // After the line that shows more.
        Knob::MaxDepth(depth, quality) => adaptive(255.0 * quality.rmse()) + f64::from(depth),
    }
}

/// Whether a setting still tells something after what was measured.
pub(super) fn worthwhile(step: &Step, points: &[Point], target: f64) -> bool {
    match step {
        // Finer grids than twice as good as wanted only cost time.
        Step::Ours(knob @ (Knob::Samples(_) | Knob::Scrambled(_))) => {
            !points.iter().any(|p| p.method == knob.method() && p.metrics.rmse_steps() <= 0.5 * target)
        }
        _ => true,
    }
}

/// What renders are expected to take, learnt from those before: seconds for what costs 1, for each kind.
#[derive(Clone, Copy, Debug)]
pub(super) struct Costs {
    uniform: f64,
    adaptive: f64,
    povray: f64,
}

impl Costs {
    /// From the time of a render of one sample a pixel.
    pub(super) fn new(one_sample: Duration) -> Self {
        let unit = one_sample.as_secs_f64().max(1e-4);
        Self { uniform: unit, adaptive: unit, povray: unit }
    }

    fn unit(&mut self, step: &Step) -> &mut f64 {
        match step {
            Step::Ours(Knob::Samples(_) | Knob::Scrambled(_)) => &mut self.uniform,
            Step::Ours(_) => &mut self.adaptive,
            Step::PovRay(_) => &mut self.povray,
        }
    }

    /// One render of a setting.
    pub(super) fn expect(mut self, step: &Step) -> Duration {
        seconds(*self.unit(step) * step.rough_cost())
    }

    /// All renders of a setting.
    pub(super) fn expect_runs(self, step: &Step, repeat: Option<u32>) -> Duration {
        let once = self.expect(step);
        once.saturating_mul(runs(repeat, once))
    }

    /// One render of a uniform grid.
    pub(super) fn expect_grid(self, grid: u32) -> Duration {
        self.expect(&Step::Ours(Knob::Samples(grid)))
    }

    /// Learns from a render.
    pub(super) fn learn(&mut self, step: &Step, took: Duration) {
        *self.unit(step) = (took.as_secs_f64() / step.rough_cost()).max(1e-9);
    }
}

fn seconds(s: f64) -> Duration {
    Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX)
}

/// How often a setting is rendered in all, after the first time took `first`: short times are uncertain.
pub(super) fn runs(repeat: Option<u32>, first: Duration) -> u32 {
    repeat.unwrap_or(match first.as_secs_f64() {
        s if s < 0.3 => 5,
        s if s < 1.5 => 3,
        _ => 1,
    })
}

/// The first grids of a reference of `samples` a pixel; of fewer, where nobody insists on them
/// and they do not fit into the budget's share.
pub(super) fn first_grids(samples: Option<u32>, costs: Costs, budget: Option<Duration>) -> [u32; 2] {
    let wanted = reference::pair_of(samples.unwrap_or(REFERENCE_SAMPLES));
    let (None, Some(budget)) = (samples, budget) else { return wanted };
    let fits = |[a, b]: &[u32; 2]| {
        (costs.expect_grid(*a).saturating_add(costs.expect_grid(*b))) <= budget.mul_f64(REFERENCE_SHARE)
    };
    [wanted, [7, 11], [5, 7]].into_iter().find(fits).unwrap_or([3, 5])
}

/// The next grids of a reference that is not yet good enough, if there is time for them.
pub(super) fn more_grids(
    (finest, own_error): (u32, f64),
    target: f64,
    costs: Costs,
    (elapsed, budget): (Duration, Option<Duration>),
) -> Option<[u32; 2]> {
    if 255.0 * own_error * REFERENCE_BETTER <= target {
        return None;
    }
    let [a, b] = reference::pair_after(finest).filter(|[_, b]| *b <= REFERENCE_GRID)?;
    let took = elapsed.saturating_add(costs.expect_grid(a)).saturating_add(costs.expect_grid(b));
    budget.is_none_or(|budget| took <= budget.mul_f64(REFERENCE_SHARE)).then_some([a, b])
}

/// The middle one of several times; of an even number, the earlier of the two.
pub(super) fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times.get(times.len().saturating_sub(1) / 2).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::knob::Method;
    use crate::measure::pareto::tests::point;

    fn second() -> Costs {
        Costs::new(Duration::from_secs(1))
    }

    #[test]
    fn every_way_is_tried_cheap_ones_first() {
        let shorter = |depth: u32| Some((depth, Quality::Normal));
        let all = steps(0.5, shorter(16), true);
        assert_eq!(all[0], Step::Ours(Knob::Samples(1)));
        let quality = Knob::Quality(Quality::Normal);
        for needed in
            [Knob::MaxError(1.0), Knob::Samples(8), Knob::Scrambled(8), quality, Knob::MaxDepth(2, Quality::Normal)]
        {
            assert!(all.contains(&Step::Ours(needed)), "{needed:?}");
        }
        assert!(peer::LADDER.iter().all(|rung| all.contains(&Step::PovRay(*rung))));
        // Nothing twice under two names.
        assert!(!all.contains(&Step::Ours(Knob::MaxError(0.5))));
        let costs: Vec<f64> = all.iter().map(Step::rough_cost).collect();
        assert!(costs.is_sorted());
        let without =
            |steps: Vec<Step>| steps.iter().all(|s| !matches!(s, Step::Ours(Knob::MaxDepth(..)) | Step::PovRay(_)));
        assert!(without(steps(0.5, None, false)) && without(steps(0.5, shorter(1), false)));
    }

    #[test]
    fn grids_far_beyond_the_target_are_left_out() {
        let reached = [point(Method::Samples, "64", 3.0, 0.2), point(Method::MaxError, "0.5", 1.0, 0.1)];
        let (finer, adaptive) = (Step::Ours(Knob::Samples(10)), Step::Ours(Knob::MaxError(0.25)));
        assert!(!worthwhile(&finer, &reached, 0.5));
        assert!(worthwhile(&adaptive, &reached, 0.5));
        assert!(worthwhile(&finer, &reached[1..], 0.5));
    }

    #[test]
    fn references_fit_into_half_the_budget_unless_samples_are_given() {
        let minutes = |m: u64| Some(Duration::from_secs(60 * m));
        assert_eq!(first_grids(None, second(), None), [11, 13]);
        assert_eq!(first_grids(None, second(), minutes(10)), [11, 13]);
        assert_eq!(first_grids(None, second(), minutes(6)), [7, 11]);
        assert_eq!(first_grids(None, second(), minutes(1)), [3, 5]);
        assert_eq!(first_grids(Some(1024), second(), minutes(1)), [23, 29]);
    }

    #[test]
    fn references_grow_until_they_are_far_better_than_the_target() {
        let now = (Duration::from_secs(300), None);
        assert_eq!(more_grids((13, 0.2 / 255.0), 0.5, second(), now), Some([17, 19]));
        assert_eq!(more_grids((13, 0.09 / 255.0), 0.5, second(), now), None);
        let tight = (Duration::from_secs(300), Some(Duration::from_secs(1800)));
        assert_eq!(more_grids((13, 0.2 / 255.0), 0.5, second(), tight), None);
        assert_eq!(more_grids((31, 1.0), 0.5, second(), now), None);
    }

    #[test]
    fn times_are_repeated_where_short_and_learnt_from() {
        let s = Duration::from_secs_f64;
        assert_eq!([s(0.01), s(1.0), s(9.0)].map(|t| runs(None, t)), [5, 3, 1]);
        assert_eq!(runs(Some(2), s(0.01)), 2);
        assert_eq!(median(vec![s(3.0), s(1.0), s(2.0)]), s(2.0));
        assert_eq!(median(vec![s(3.0), s(1.0)]), s(1.0));
        let mut costs = second();
        let (rough, finer) = (Step::Ours(Knob::MaxError(0.5)), Step::Ours(Knob::MaxError(0.25)));
        let before = costs.expect(&finer);
        costs.learn(&rough, costs.expect(&rough) * 2);
        assert!((costs.expect(&finer).as_secs_f64() / before.as_secs_f64() - 2.0).abs() < 1e-6);
        assert_eq!(costs.expect_grid(4), s(16.0));
    }
}
