//! The sampler's model of errors.

use tessera_core::settings::Tolerance;
use tessera_tests::edges;

use crate::table::{Row, Table, power};

/// Edges.
const EDGES: u64 = 300;
/// Points a pixel. The least are no fit: edges are closer than they.
const POINTS: [u32; 4] = [4, 16, 64, 256];
const FEW: usize = 1;

/// Of the error's mean square, what doubling the points takes off.
fn doubling() -> f64 {
    1.0 - 2f64.powf(-1.5)
}

/// What a point must take off at a tolerance of so many steps.
fn a_point(steps: f64) -> f64 {
    let tolerance = Tolerance::new(steps / 255.0);
    doubling() * tolerance.fraction() * tolerance.fraction() / tolerance.typical_points()
}

/// The loosest tolerance under which a pixel of two points, one white and one black, is worth more of them, in steps.
pub(crate) fn loosest() -> f64 {
    let model = Tolerance::MODEL;
    let worth = |steps: f64| doubling() * model.edge * 0.5 > a_point(steps) * (2.0 * model.least_growth).powf(2.5);
    (1..1020).map(f64::from).take_while(|steps| worth(*steps)).last().unwrap_or(0.0)
}

pub(crate) fn fit() -> Table {
    let seen = edges::measure(0..EDGES, &POINTS);
    let at = |k: usize| -> Vec<edges::Seen> { seen.iter().map(|of| of[k]).collect() };
    let kappas: Vec<f64> = (0..POINTS.len()).map(|k| edges::kappa(&at(k), POINTS[k])).collect();
    let first = at(0);
    let pixels: f64 = first.iter().map(|s| s.pixels).sum();
    let variance = first.iter().map(|s| s.variance).sum::<f64>() / pixels;
    let squares: Vec<(f64, f64)> = (FEW..POINTS.len())
        .map(|k| (f64::from(POINTS[k]), at(k).iter().map(|s| s.squares).sum::<f64>() / pixels))
        .collect();
    // The power of every tenth part of the edges by itself tells how sure it is.
    let parts: Vec<f64> = (0..10)
        .map(|part| {
            let some = |k: usize| at(k).into_iter().skip(part).step_by(10).map(|s| s.squares).sum::<f64>();
            -power(&(FEW..POINTS.len()).map(|k| (f64::from(POINTS[k]), some(k))).collect::<Vec<_>>())
        })
        .collect();
    let model = Tolerance::MODEL;
    let by_points: Vec<String> = POINTS.iter().zip(&kappas).map(|(n, k)| format!("{n}: {k:.3}")).collect();
    let edge = Row::of(
        "edge",
        "",
        model.edge,
        &kappas[FEW..],
        format!("{pixels:.0} pixels on {EDGES} edges; by points {}", by_points.join(", ")),
    );
    let typical: Vec<f64> = kappas[FEW..].iter().map(|k| k * variance).collect();
    let typical = Row::of("typical", "", model.typical, &typical, format!("the same, of mean variance {variance:.3}"));
    let fall = Row { fitted: -power(&squares), ..Row::of("exponent", "", 1.5, &parts, "the same") };
    let follows = |name: &'static str, now: f64, steps: f64| {
        Row::of(name, "", now, &[a_point(steps)], format!("`typical`, at {steps} steps"))
    };
    let followers = [
        follows("loose_point", model.loose_point, 4.0),
        follows("loose", model.loose, 10.0),
        follows("tight", model.tight, 1.0),
    ];
    Table::new("sampler", &model, [edge, fall, typical].into_iter().chain(followers).collect())
}
