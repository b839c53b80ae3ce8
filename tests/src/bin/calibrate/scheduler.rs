//! The scheduler's model of costs and times.

use std::process::Command;

use coordinator::simulation::MODEL;
use tessera_tests::program::program;
use tessera_tests::{costs, generate};

use crate::table::{Held, Row, Table, quantile};
use crate::{Result, crowd};

/// Pixels of the pictures whose parts are timed.
const SIZE: (u32, u32) = (320, 240);
/// Workers that render nothing, of a real coordinator, and for how long.
const WORKERS: [&str; 2] = ["500", "1000"];
const SECONDS: &str = "4";

pub(crate) fn fit() -> Result<Table> {
    let mut rows = vec![each()?];
    rows.extend(tiles()?);
    rows.extend(crowd::fit()?);
    Ok(Table::new("scheduler", &MODEL, rows))
}

/// What a tile takes of a real coordinator's processors, by the program that measures it.
fn each() -> Result<Row> {
    let mut taken: Vec<f64> = Vec::new();
    for workers in WORKERS {
        let out = Command::new(program("crowd")).args(["--workers", workers, "--seconds", SECONDS]).output()?;
        let text = String::from_utf8_lossy(&out.stdout);
        // "the coordinator took 42.0 µs of processor time a tile"
        let told = text.lines().find_map(|l| l.strip_prefix("the coordinator took ")?.split(' ').next()?.parse().ok());
        taken.push(told.ok_or_else(|| format!("crowd told nothing: {}", String::from_utf8_lossy(&out.stderr)))?);
    }
    let now = 1e6 * MODEL.each.as_secs_f64();
    let data = format!("processor time a tile of 100 ms, with {} workers", WORKERS.join(" and "));
    Ok(Row::bound("each", "µs", now, &taken, data))
}

/// What parts of pictures cost: of squares of 16 pixels, a thread each.
fn tiles() -> Result<Vec<Row>> {
    let (mut dearest, mut most, mut usual) = (Vec::new(), Vec::new(), Vec::new());
    for document in [generate::demo(), generate::lights(1000, 100), generate::mirrors(), generate::terrain(64)] {
        let text = costs::measure(&document, SIZE)?;
        let costs: Vec<f64> = text.split_ascii_whitespace().map(str::parse).collect::<std::result::Result<_, _>>()?;
        let mean = costs.iter().sum::<f64>() / costs.len().max(1) as f64;
        dearest.push(quantile(&costs, 1.0) / mean);
        most.push(quantile(&costs, 0.9) / mean);
        usual.push(mean);
    }
    let scenes = usual.len();
    // As many pixels as take what is between the shortest and the longest tile, on a logarithmic scale.
    let ns = 1e9 * (MODEL.shortest.as_secs_f64() * MODEL.longest.as_secs_f64()).sqrt();
    let probes: Vec<f64> = usual.iter().map(|cost| ns / cost).collect();
    let (least, greatest) = (quantile(&probes, 0.0), quantile(&probes, 1.0));
    let probe = Row::of(
        "probe",
        "pixels",
        MODEL.probe,
        &probes,
        format!("pixels of {:.0} ms, {scenes} scenes; the least counts for more", ns / 1e6),
    );
    let squares = format!("squares of 16 × 16 pixels, {scenes} scenes");
    Ok(vec![
        Row::bound("most_spread", "", MODEL.most_spread, &dearest, format!("the dearest by the mean: {squares}")),
        Row::bound(
            "stuck_spread",
            "",
            f64::from(MODEL.stuck_spread),
            &most,
            format!("nine of ten by the mean: {squares}"),
        ),
        Row { spread: (least, greatest), held: Held::Tried((least..=greatest).contains(&MODEL.probe)), ..probe },
    ])
}
