//! The plan's model of errors and costs.

use coordinator::plan_model::MODEL;
use tessera_core::settings::{AuditRate, Detail, Tolerance};

use crate::Result;
use crate::pictures::{Picture, Shot};
use crate::sampler;
use crate::table::{Held, Row, Table, power, quantile};

/// Tolerances, in steps: those that lead to the errors that people ask for.
const TOLERANCES: [f64; 5] = [16.0, 8.0, 4.0, 2.0, 1.0];
/// Errors asked for, in steps: draft and normal.
const TARGETS: [f64; 2] = [2.0, 0.5];
/// Edges of the blocks of looks, and of tiles in the middle of a render.
const SPOT: u32 = 8;
const TILE: u32 = 32;

pub(crate) fn fit() -> Result<Table> {
    let pictures = Picture::all()?;
    let shots: Vec<Vec<Shot>> = pictures.iter().map(|p| TOLERANCES.map(|t| p.within(t)).into()).collect();
    let mut rows = errors(&shots);
    rows.extend(costs(&pictures, &shots));
    rows.push(aims(&pictures)?);
    Ok(Table::new("plan", &MODEL, rows))
}

/// What tolerances lead to.
fn errors(shots: &[Vec<Shot>]) -> Vec<Row> {
    let by_tolerance = |y: fn(&Shot) -> f64| -> Vec<f64> {
        let of = |shots: &Vec<Shot>| power(&TOLERANCES.iter().zip(shots).map(|(t, s)| (*t, y(s))).collect::<Vec<_>>());
        shots.iter().map(of).collect()
    };
    let rising = |powers: Vec<f64>| -> Vec<f64> { powers.iter().map(|p| -p).collect() };
    // The tolerance that leads to half a step, by the power of each scene.
    let powers = by_tolerance(|s| s.rmse);
    let guesses: Vec<f64> = shots
        .iter()
        .zip(&powers)
        .map(|(shots, power)| {
            let off = shots.iter().zip(TOLERANCES).map(|(s, t)| (255.0 * s.rmse).ln() - power * t.ln());
            let at_one = off.sum::<f64>() / TOLERANCES.len() as f64;
            ((0.5f64.ln() - at_one) / power).exp() / 0.5
        })
        .collect();
    let off: Vec<f64> = shots.iter().flatten().map(|s| (s.rmse / s.error.expected_rmse()).ln().abs()).collect();
    let scenes = shots.len();
    let data = |what: &str| format!("{what}, {scenes} scenes within 16 to 1 steps");
    let square = (off.iter().map(|o| o * o).sum::<f64>() / off.len().max(1) as f64).sqrt();
    let model = Row::of("expected_off", "", MODEL.expected_off, &off, data("true to expected errors"));
    vec![
        Row::of(
            "guess",
            "",
            MODEL.guess,
            &guesses,
            "the tolerance that leads to half a step, by the line of each scene",
        ),
        Row::of("error_power", "", MODEL.error_power, &powers, data("true errors")),
        Row { fitted: square, ..model },
        Row::of("time_power", "", MODEL.time_power, &rising(by_tolerance(|s| s.seconds)), data("seconds")),
        Row::of(
            "points_power",
            "",
            MODEL.points_power,
            &rising(by_tolerance(|s| s.points - 0.9 * MODEL.first_points)),
            data("points beyond 0.9 of the first"),
        ),
    ]
}

/// What passes cost, in points: rays from the camera, which any machine has as many of.
fn costs(pictures: &[Picture], shots: &[Vec<Shot>]) -> Vec<Row> {
    let scenes = pictures.len();
    let first: Vec<f64> = pictures.iter().map(|p| p.within(255.0 * MODEL.loosest).points).collect();
    let steps = 255.0 * MODEL.timed_tolerance;
    let within = Detail::Within(Tolerance::new(MODEL.timed_tolerance));
    let rate = AuditRate((MODEL.most_rate * 65536.0) as u32);
    let audited: Vec<(f64, f64, f64)> = pictures
        .iter()
        .map(|p| {
            let (without, _) = p.in_tiles(within, AuditRate::default(), TILE, 1);
            let (with, error) = p.in_tiles(within, rate, TILE, 1);
            let drawn = error.audited as f64 / (error.pixels as f64 * rate.factor());
            ((with / without - 1.0) / rate.factor(), drawn, with)
        })
        .collect();
    let column = |of: fn(&(f64, f64, f64)) -> f64| -> Vec<f64> { audited.iter().map(of).collect() };
    // As many steps as the first look takes for a picture that is normal.
    let look = 0.5 * MODEL.guess;
    let at = TOLERANCES.iter().position(|t| *t == look);
    let looks: Vec<f64> = pictures
        .iter()
        .zip(shots)
        .map(|(p, shots)| {
            let whole = at.map_or_else(|| p.within(look).points, |at| shots[at].points);
            p.in_tiles(Detail::Glance(Tolerance::new(look / 255.0)), MODEL.look_rate, SPOT, 3).0 / whole
        })
        .collect();
    let at_timed = format!("within {steps} steps, {scenes} scenes in tiles of {TILE} pixels");
    let least = sampler::loosest() / 255.0;
    vec![
        Row::of(
            "first_points",
            "a pixel",
            MODEL.first_points,
            &first,
            format!("within {:.0} steps, {scenes} scenes", 255.0 * MODEL.loosest),
        ),
        Row::bound("loosest", "", MODEL.loosest, &[least], "the sampler's model: where two unlike points are enough"),
        Row::of("audit_cost", "", MODEL.audit_cost, &column(|a| a.0), format!("{at_timed}, at {}", MODEL.most_rate)),
        Row::of("drawn", "", MODEL.drawn, &column(|a| a.1), format!("{at_timed}, at {}", MODEL.most_rate)),
        Row::of("timed_points", "a pixel", MODEL.timed_points, &column(|a| a.2), at_timed),
        Row::of("audited_look", "", MODEL.audited_look, &looks, format!("blocks of a look within {look} steps")),
    ]
}

/// What pictures come to that aim at an error.
fn aims(pictures: &[Picture]) -> Result<Row> {
    let (mut found, mut told) = (Vec::new(), Vec::new());
    for picture in pictures {
        for target in TARGETS {
            let (error, upper) = picture.towards(target)?;
            found.push(error);
            told.push(upper);
        }
    }
    let met = told.iter().filter(|upper| **upper <= 1.0).count();
    let (most, kept) = (quantile(&found, 1.0), found.iter().filter(|e| **e <= 1.0).count());
    Ok(Row {
        held: Held::Tried(kept == found.len() && met == told.len()),
        ..Row::of(
            "most_aim",
            "",
            MODEL.most_aim,
            &found,
            format!(
                "true errors, as shares of 2 and 0.5 steps asked for; the greatest is {most:.2}, {met} of {} met",
                told.len()
            ),
        )
    })
}
