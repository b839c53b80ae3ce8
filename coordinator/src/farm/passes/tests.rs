use proptest::prelude::*;

use super::*;
use crate::plan::Goal;

const WHOLE: Region = Region { x0: 3, y0: 4, x1: 203, y1: 154 };

/// A pixel's expected squared error: more in some parts of the picture, and the less the finer the tolerance.
fn error(region: &Region, pass: Option<Pass>) -> ErrorEstimate {
    let fine = match pass.map(|p| p.detail) {
        Some(Detail::Within(tolerance) | Detail::Glance(tolerance)) => tolerance.fraction(),
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
            passes.accept(region, &done, (String::new(), None));
            let kept = Kept { lease, error, rays: done.rays, place: Location::default(), made: None };
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
