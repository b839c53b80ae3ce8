use tessera_core::film::Sum;

use super::*;

/// What `step` gives of a picture whose pixels' squared errors are `square`, which the sampler expects and an audit
/// finds; how sure that is is as in a real one.
fn outcome(step: &Step, whole: Region, square: impl Fn(u32, u32) -> f64) -> Outcome {
    let regions = if step.regions.is_empty() { vec![whole] } else { step.regions.clone() };
    let (rate, typical) = match step.pass {
        Some(Pass { detail: Detail::Within(t) | Detail::Glance(t), audit }) => {
            (audit.factor(), t.fraction() * t.fraction())
        }
        _ => (1.0, 1.0),
    };
    let tile = |r: Region| {
        let (mut squares, mut variance, mut audited) = (0.0, 0.0, 0.0);
        for (x, y) in (r.y0..r.y1).flat_map(|y| (r.x0..r.x1).map(move |x| (x, y))) {
            let s = square(x, y);
            let probability = (rate * (1.0 / 16.0 + s / typical)).min(1.0);
            audited += probability;
            squares += s;
            variance += s * s * (4.0 - probability) / probability;
        }
        let (expected, squares, variance) = (Sum::new(squares), Sum::new(squares), Sum::new(variance));
        let audited = (audited as u64).clamp(1, r.area());
        (r, ErrorEstimate { pixels: r.area(), expected, audited, squares, variance })
    };
    let tiles: Vec<(Region, ErrorEstimate)> = regions.into_iter().map(tile).collect();
    let mut error = ErrorEstimate::default();
    tiles.iter().for_each(|(_, e)| error += *e);
    Outcome { error, tiles, ..Outcome::default() }
}

fn tolerance(step: &Step) -> f64 {
    match step.pass.map(|p| p.detail) {
        Some(Detail::Within(tolerance) | Detail::Glance(tolerance)) => tolerance.fraction(),
        other => panic!("{other:?}"),
    }
}

/// Of a picture whose error falls with a power of the tolerance, and never below `least` nor above `most`.
fn picture(step: &Step, whole: Region, (scale, power, least, most): (f64, f64, f64, f64)) -> Outcome {
    let rmse = (scale * libm::pow(tolerance(step), power)).clamp(least, most);
    // One pixel in eight is on an edge.
    outcome(step, whole, |x, y| if (x + 3 * y).is_multiple_of(8) { 8.0 * rmse * rmse } else { 0.0 })
}

fn region() -> Region {
    Region { x0: 0, y0: 0, x1: 640, y1: 480 }
}

fn plan(target: f64) -> Plan {
    Plan::new(Goal::Error(target), region(), region())
}

/// Runs a plan to its end: the steps, and what the last of them gave.
fn run(mut plan: Plan, gives: impl Fn(&Step) -> Outcome) -> (Vec<Step>, Outcome, bool) {
    let mut steps = vec![plan.first()];
    for _ in 0..30 {
        let last = steps.last().expect("a step");
        let outcome = gives(last);
        match plan.next(&outcome) {
            Some(next) => steps.push(next),
            None => {
                assert!(last.kept);
                let met = plan.is_met(&outcome.error).expect("a target");
                return (steps, outcome, met);
            }
        }
    }
    panic!("no end");
}

#[test]
fn errors_asked_for_are_met_and_not_by_far() {
    for (scale, power) in [(0.5, 0.9), (0.1, 0.8), (0.5, 1.1), (0.2, 1.0)] {
        for target in [1.0 / 255.0, 0.5 / 255.0, 0.1 / 255.0] {
            let model = (scale, power, 0.0, 1.0);
            let (steps, last, met) = run(plan(target), |s| picture(s, region(), model));
            let got = last.error.rmse();
            assert!(met && got <= 0.97 * target && got > 0.6 * target, "{scale} {power}: {got} for {target}");
            assert!(steps.iter().filter(|s| s.kept).count() == 1 && steps.len() <= 4, "{} passes", steps.len());
        }
    }
}

/// What errs was not expected, and finer tolerances change nothing of it: only a closer audit tells that it is little.
#[test]
fn an_error_that_is_met_and_not_surely_is_audited_more_closely() {
    let target = 0.5 / 255.0;
    let square = 120.0 * 0.7 * 0.7 * target * target;
    let gives = |step: &Step| {
        let Some(Pass { audit, .. }) = step.pass else { panic!("{step:?}") };
        let probability = (audit.factor() / 16.0).min(1.0);
        let mut found = outcome(step, region(), |x, y| if (x + 7 * y).is_multiple_of(120) { square } else { 0.0 });
        // Drawn as what is not expected to err is.
        found.error.expected = Sum::new(0.25 * found.error.squares.value());
        found.error.variance = Sum::new(found.error.squares.value() * square * (4.0 - probability) / probability);
        found
    };
    let (steps, last, met) = run(plan(target), gives);
    assert!(met, "{} passes, {:?}", steps.len(), last.error.interval());
    let rates: Vec<f64> =
        steps.iter().filter(|s| s.kept).filter_map(|s| s.pass).map(|pass| pass.audit.factor()).collect();
    assert!(rates.len() > 1 && rates.is_sorted_by(|a, b| a < b), "{rates:?}");
}

#[test]
fn a_small_picture_is_searched_as_a_whole_and_kept() {
    let small = Region { x0: 0, y0: 0, x1: 48, y1: 36 };
    for target in [2.0 / 255.0, 0.5 / 255.0, 0.1 / 255.0] {
        for (scale, power) in [(1.0, 0.85), (0.2, 0.6), (3.0, 1.1)] {
            let model = (scale, power, 0.0, 1.0);
            let (steps, last, met) = run(Plan::new(Goal::Error(target), small, small), |s| picture(s, small, model));
            assert!(steps.iter().all(|s| s.kept && s.regions.is_empty()));
            let got = last.error.rmse();
            assert!(met && got > target / 3.0, "{scale} {power}: {got} for {target}");
        }
    }
}

/// What decides the tolerance is the view's, whatever is rendered of it.
#[test]
fn a_region_is_rendered_within_the_tolerance_of_the_whole() {
    for view in [region(), Region { x0: 0, y0: 0, x1: 50, y1: 40 }] {
        let part = Region { x0: 11, y0: 5, x1: 37, y1: 29 };
        let uneven = |s: &Step, whole| {
            let t = tolerance(s);
            outcome(s, whole, |x, y| 1e-2 * t * t * f64::from(x / 8 % 7 + y / 8 % 5))
        };
        let (whole, _, met) = run(Plan::new(Goal::Error(0.002), view, view), |s| uneven(s, view));
        let (cut, _, cut_met) = run(Plan::new(Goal::Error(0.002), view, part), |s| {
            // Looks see the view, the render its part.
            uneven(s, if s.kept { part } else { view })
        });
        assert_eq!(tolerance(&whole[whole.len() - 1]), tolerance(&cut[cut.len() - 1]));
        assert_eq!((met, cut_met), (true, true));
        assert!(cut.iter().filter(|s| s.kept).count() == 1 && !cut[0].kept);
    }
}

/// Of a picture that errs in `part` alone, where errors are as the tolerance but never above `most`.
fn speck(step: &Step, whole: Region, part: Region, most: f64) -> Outcome {
    let tolerance = tolerance(step).min(most);
    outcome(step, whole, |x, y| {
        let inside = (part.x0..part.x1).contains(&x) && (part.y0..part.y1).contains(&y);
        if inside { tolerance * tolerance } else { 0.0 }
    })
}

#[test]
fn what_no_look_meets_is_met_by_another_render() {
    let target = 0.5 / 255.0;
    for (x0, y0) in [(0, 0), (301, 203), (77, 400), (555, 31), (160, 120), (431, 333)] {
        let part = Region { x0, y0, x1: x0 + 32, y1: y0 + 24 };
        let (steps, last, met) = run(plan(target), |s| speck(s, region(), part, 0.2));
        assert!(met && last.error.rmse() <= target);
        assert!(steps.iter().filter(|s| s.kept).count() <= 3, "{x0},{y0}");
    }
}

#[test]
fn what_cannot_be_met_ends_and_is_said() {
    for view in [region(), Region { x0: 0, y0: 0, x1: 48, y1: 36 }] {
        let model = (1.0, 0.85, 1e-3, 1.0);
        let (steps, _, met) = run(Plan::new(Goal::Error(1e-6), view, view), |s| picture(s, view, model));
        assert!(!met && steps.len() <= 8, "{}", steps.len());
    }
}

#[test]
fn what_is_good_enough_at_first_points_is_not_refined() {
    let (steps, last, met) = run(plan(2.0 / 255.0), |s| picture(s, region(), (1.0, 1.0, 0.0, 0.5 / 255.0)));
    assert!(met && last.error.rmse() < 1.0 / 255.0 && steps.len() <= 5);
}

#[test]
fn large_pictures_are_audited_little_and_small_ones_whole() {
    use tessera_core::settings::AuditRate;
    let seen = |pixels: u64| ErrorEstimate { pixels, audited: pixels / 10, ..Default::default() };
    let look = AuditRate(1 << 14);
    assert_eq!(cost::audit(3000, Some((&seen(3000), look))).0, AuditRate::ALL);
    for (w, h) in [(640, 480), (1920, 1080), (8000, 6000)] {
        let (rate, drawn) = cost::audit(w * h, Some((&seen(6400), look)));
        assert!((1000.0..=3000.0).contains(&drawn) && rate.factor() <= 0.041, "{w}x{h}: {drawn}");
    }
}

#[test]
fn under_a_time_limit_a_coarse_picture_comes_first_and_the_worst_is_refined_first() {
    let limit = Duration::from_secs(10);
    let mut plan = Plan::new(Goal::Time { limit, error: None }, region(), region());
    let first = plan.first();
    assert_eq!(first.pass.map(|p| p.detail), Some(Detail::Coarse { step: 8 }));
    assert!(first.kept && first.regions.is_empty() && plan.limit() == Some(limit));
    let tile = |x0| Region { x0, y0: 0, x1: x0 + 32, y1: 32 };
    let of = |squares: f64| {
        let squares = Sum::new(squares);
        ErrorEstimate { pixels: 1024, expected: squares, squares, audited: 9, ..Default::default() }
    };
    let tiles = vec![(tile(0), of(1.0)), (tile(32), of(100.0)), (tile(64), of(10.0))];
    let ms = Duration::from_millis;
    let after = |took, now| Outcome { error: of(111.0), tiles: tiles.clone(), took: ms(took), now: ms(now) };
    let fine = plan.next(&after(1, 200)).expect("there is time");
    assert!(fine.kept && tolerance(&fine) > 0.01);
    assert_eq!(fine.regions, [tile(32), tile(64), tile(0)]);
    let finer = plan.next(&after(100, 400)).expect("there is time");
    assert!(tolerance(&finer) < tolerance(&fine));
    assert!(plan.next(&Outcome { now: limit, ..after(1, 0) }).is_none());
}

#[test]
fn where_time_is_short_coarse_pictures_get_finer() {
    let mut plan = Plan::new(Goal::Time { limit: Duration::from_secs(1), error: None }, region(), region());
    plan.first();
    let mut now = Duration::ZERO;
    let mut details = Vec::new();
    // A point in every square of 8 pixels takes 30 ms: all pixels would take two seconds.
    let mut took = Duration::from_millis(30);
    loop {
        now += took;
        let Some(step) = plan.next(&Outcome { took, now, ..Outcome::default() }) else { break };
        let detail = step.pass.expect("a pass").detail;
        details.push(detail);
        took = match detail {
            Detail::Coarse { step } => Duration::from_millis(30) * 64 / (step * step),
            Detail::Within(_) | Detail::Glance(_) => Duration::from_secs(12),
        };
    }
    assert!(
        details.contains(&Detail::Coarse { step: 4 }) || details.contains(&Detail::Coarse { step: 2 }),
        "{details:?}"
    );
}

#[test]
fn an_error_reached_before_the_time_is_up_is_enough() {
    let limit = Duration::from_secs(10);
    let mut plan = Plan::new(Goal::Time { limit, error: Some(0.5) }, region(), region());
    let step = plan.first();
    let outcome = outcome(&step, region(), |_, _| 0.01);
    assert!(plan.next(&outcome).is_none());
    assert_eq!(plan.is_met(&outcome.error), Some(true));
}
