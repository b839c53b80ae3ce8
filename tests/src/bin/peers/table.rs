//! Results as Markdown.

use std::fmt::Write as _;

use crate::Row;
use crate::extremes;
use crate::figures::Series;
use crate::program::Program;

/// A Markdown table: the first column is text, the others are numbers.
struct Table {
    text: String,
}

impl Table {
    fn new(title: &str, columns: &[String]) -> Self {
        let rule = format!("| --- |{}", " ---: |".repeat(columns.len() - 1));
        Self { text: format!("\n{title}\n\n| {} |\n{rule}\n", columns.join(" | ")) }
    }

    fn row(&mut self, cells: &[String]) {
        let _ = writeln!(self.text, "| {} |", cells.join(" | "));
    }
}

/// At three significant digits.
fn digits(x: f64) -> String {
    match x.abs() {
        a if a >= 99.95 => format!("{x:.0}"),
        a if a >= 9.995 => format!("{x:.1}"),
        a if a >= 0.9995 => format!("{x:.2}"),
        _ => format!("{x:.3}"),
    }
}

fn cell(x: Option<f64>) -> String {
    x.map_or_else(|| "–".into(), digits)
}

/// A peer's time, and how many times ours it is.
fn against(peer: Option<&Series>, ours: &Series, figure: &str) -> String {
    let both = peer.and_then(|p| Some((p.median(figure)?, p.ratio(figure, ours, figure)?)));
    both.map_or_else(|| "–".into(), |(time, ratio)| format!("{} ({}×)", digits(time), digits(ratio)))
}

/// Whole jobs, what is in them, and whether the pictures are the same.
pub(crate) fn jobs(programs: &[Program], rows: &[Row]) -> String {
    let names = |first: &[&'static str]| -> Vec<String> {
        first.iter().copied().chain(programs.iter().map(Program::name)).map(str::to_owned).collect()
    };
    let peers: Vec<&str> = programs.iter().skip(1).map(Program::name).collect();
    let mut whole = Table::new(
        "Whole job in seconds, from start to written picture (in brackets: a peer's time as a multiple of \
         Tessera's, the median over rounds)",
        &names(&["scene", "objects"]),
    );
    let mut columns: Vec<String> =
        ["scene", "read", "build", "trace", "write", "Mrays/s", "refined"].map(str::to_owned).into();
    columns.extend(peers.iter().map(|p| format!("{p} trace")));
    let mut phases = Table::new("Tessera's phases in seconds, and the peers' trace times", &columns);
    let mut memory = Table::new("Peak memory in MB", &names(&["scene"]));
    columns = vec!["scene".to_owned()];
    columns.extend(peers.iter().flat_map(|p| [format!("{p} RMSE"), "pixels off by more than 1/255".to_owned()]));
    let mut apart = Table::new("How far the 8-bit pictures are from Tessera's (linear, full scale 1)", &columns);

    for row in rows {
        let Some(((_, Some(ours)), others)) = row.series.split_first() else { continue };
        let mut cells = vec![row.scene.clone(), row.objects.to_string(), cell(ours.median("whole"))];
        cells.extend(others.iter().map(|(_, s)| against(s.as_ref(), ours, "whole")));
        whole.row(&cells);

        cells = vec![row.scene.clone()];
        cells.extend(["read", "build", "trace", "write"].map(|phase| cell(ours.median(phase))));
        cells.push(cell(ours.ratio("rays", ours, "trace").map(|r| r / 1e6)));
        let refined = ours.ratio("refined", ours, "rays");
        cells.push(refined.map_or_else(|| "–".into(), |r| format!("{:.4} %", 100.0 * r)));
        cells.extend(others.iter().map(|(_, s)| against(s.as_ref(), ours, "trace")));
        phases.row(&cells);

        cells = vec![row.scene.clone()];
        let peak = |s: &Option<Series>| cell(s.as_ref().and_then(|s| s.median("peak")).map(|b| b / 1e6));
        cells.extend(row.series.iter().map(|(_, s)| peak(s)));
        memory.row(&cells);

        cells = vec![row.scene.clone()];
        for (_, series) in others {
            let figure = |name| series.as_ref().and_then(|s| s.median(name));
            cells.push(figure("rmse").map_or_else(|| "–".into(), |r| format!("{r:.5}")));
            cells.push(figure("off").map_or_else(|| "–".into(), |r| format!("{:.3} %", 100.0 * r)));
        }
        apart.row(&cells);
    }
    let mut text = [whole.text, phases.text, memory.text].concat();
    if !peers.is_empty() {
        text.push_str(&apart.text);
    }
    text
}

/// What the farm costs.
pub(crate) fn farm(rows: &[(String, Series)]) -> String {
    let columns = ["scene", "core, 2 threads", "farm, 2 × 1", "overhead", "farm, 1 × 1", "speed-up of 2 × 1"];
    let mut table = Table::new(
        "The farm in seconds: workers × threads over gRPC in one process, beside core called directly",
        &columns.map(str::to_owned),
    );
    for (name, series) in rows {
        let overhead = series.ratio("two", series, "core").map(|r| format!("{:+.1} %", 100.0 * (r - 1.0)));
        table.row(&[
            name.clone(),
            cell(series.median("core")),
            cell(series.median("two")),
            overhead.unwrap_or_default(),
            cell(series.median("one")),
            cell(series.ratio("one", series, "two")),
        ]);
    }
    table.text
}

/// What exactness costs.
pub(crate) fn exact(rows: &[(String, Series)]) -> String {
    let columns = ["scene", "exact", "without", "least / least", "median of ratios", "refined", "unresolved"];
    let mut table = Table::new(
        "Tracing in seconds by core called directly (least of all rounds), with wide arithmetic and without; rays \
         refined, and samples that even the widest numbers left open",
        &columns.map(str::to_owned),
    );
    for (name, series) in rows {
        let (exact, plain) = (series.least("exact"), series.least("plain"));
        let refined = series.median("refined").map(|r| format!("{:.4} %", 100.0 * r));
        table.row(&[
            name.clone(),
            cell(exact),
            cell(plain),
            cell(exact.zip(plain).map(|(a, b)| a / b)),
            cell(series.ratio("exact", series, "plain")),
            refined.unwrap_or_default(),
            series.median("unresolved").map(|n| n.to_string()).unwrap_or_default(),
        ]);
    }
    table.text
}

/// Who is right at the limits of numbers.
pub(crate) fn extremes(rows: &[extremes::Row]) -> String {
    let columns =
        ["scenes", "program", "could be given", "no pixel wrong", "at most 0.5 % wrong", "pixels wrong", "no picture"];
    let mut table = Table::new(
        "Scenes of 64x48 pixels against 512-bit arithmetic; a pixel is wrong where a component is further off than \
         2/255",
        &columns.map(str::to_owned),
    );
    for row in rows {
        let share = 100.0 * row.wrong as f64 / row.pixels.max(1) as f64;
        table.row(&[
            row.set.to_owned(),
            row.program.to_owned(),
            row.given.to_string(),
            row.right.to_string(),
            row.almost.to_string(),
            format!("{} ({share:.2} %)", row.wrong),
            row.failed.to_string(),
        ]);
    }
    table.text
}
