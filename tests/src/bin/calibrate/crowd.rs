//! The scheduler's constants, tried in a simulated crowd.

use std::time::Duration;

use coordinator::simulation::{MODEL, Model, Setup, Trouble, simulate};
use rayon::prelude::*;
use tessera_tests::costs;

use crate::Result;
use crate::table::{Held, Row};

/// Runs of each setup, with other workers in each.
const SEEDS: u64 = 3;
/// What is lost to no purpose, in hundredths of the workers' time: less is not worth a change.
const NOTHING: f64 = 0.1;

/// A constant, and values of it that are tried: such multiples of today's.
struct Tried {
    name: &'static str,
    unit: &'static str,
    values: Vec<f64>,
    get: fn(&Model) -> f64,
    set: fn(&mut Model, f64),
}

/// A constant that is a time, told in milliseconds.
macro_rules! time {
    ($field:ident) => {
        Tried {
            name: stringify!($field),
            unit: "ms",
            values: around(1e3 * MODEL.$field.as_secs_f64()),
            get: |model| 1e3 * model.$field.as_secs_f64(),
            set: |model, ms| model.$field = Duration::from_secs_f64(ms / 1e3),
        }
    };
}

/// One that is a number.
macro_rules! number {
    ($field:ident, $values:expr) => {
        Tried {
            name: stringify!($field),
            unit: "",
            values: $values,
            get: |model| model.$field,
            set: |model, value| model.$field = value,
        }
    };
}

fn around(now: f64) -> Vec<f64> {
    [0.25, 0.5, 1.0, 2.0, 4.0].map(|times| times * now).into()
}

fn all() -> Vec<Tried> {
    vec![
        number!(memory, vec![0.0, 0.5, MODEL.memory, 0.9, 0.95]),
        number!(parts, around(MODEL.parts)),
        number!(quicker, vec![1.0, 1.1, MODEL.quicker, 1.5, 2.0]),
        time!(longest),
        time!(shortest),
        time!(ahead),
        time!(slack),
    ]
}

/// Farms that the constants have to suit: much and little that goes wrong, even and uneven pictures, a job so short
/// that its end weighs much.
fn setups() -> Result<Vec<Setup>> {
    let seconds = Duration::from_secs;
    let trouble = Trouble { late: 0.1, slow: 0.02, killed: 0.02, cut: 0.02, resent: 0.005 };
    let (demo, lights) = (costs::read("demo")?, costs::read("lights")?);
    Ok(vec![
        Setup::new(4, seconds(10), demo.clone()),
        Setup::new(200, seconds(20), lights),
        Setup {
            trouble,
            round_trip: (Duration::from_millis(1), Duration::from_millis(100)),
            ..Setup::new(100, seconds(30), demo.clone())
        },
        Setup { scene: 64 << 10, ..Setup::new(500, seconds(8), demo) },
    ])
}

/// Tries every constant, the others as they are.
pub(crate) fn fit() -> Result<Vec<Row>> {
    let setups = setups()?;
    Ok(all().iter().map(|tried| row(tried, &setups)).collect())
}

fn row(tried: &Tried, setups: &[Setup]) -> Row {
    let losses: Vec<f64> = tried.values.par_iter().map(|value| loss(tried, *value, setups)).collect();
    let least = losses.iter().copied().fold(f64::INFINITY, f64::min);
    let good: Vec<f64> =
        tried.values.iter().zip(&losses).filter(|(_, loss)| **loss <= least + NOTHING).map(|(v, _)| *v).collect();
    let now = (tried.get)(&MODEL);
    let fitted = tried.values.iter().zip(&losses).min_by(|a, b| a.1.total_cmp(b.1)).map_or(now, |(value, _)| *value);
    let told: Vec<String> =
        tried.values.iter().zip(&losses).map(|(value, loss)| format!("{value}: {loss:.2}")).collect();
    let spread = good.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    Row {
        name: tried.name,
        unit: tried.unit,
        now,
        fitted,
        spread,
        held: Held::Tried(good.contains(&now)),
        data: format!("% of a simulated crowd's time lost: {}", told.join(", ")),
    }
}

/// Hundredths of the workers' time that do not go into the picture.
fn loss(tried: &Tried, value: f64, setups: &[Setup]) -> f64 {
    let mut model = MODEL;
    (tried.set)(&mut model, value);
    let runs: Vec<f64> = setups
        .iter()
        .flat_map(|setup| (0..SEEDS).map(move |seed| (setup, seed)))
        .map(|(setup, seed)| 100.0 * (1.0 - simulate(&Setup { seed, model, ..setup.clone() }).efficiency))
        .collect();
    runs.iter().sum::<f64>() / runs.len().max(1) as f64
}
