//! Efficiency against workers, drawn as plain SVG.

use std::fmt::Write;
use std::time::Duration;

use coordinator::simulation::{CostMap, Outcome, Service, Setup, Trouble, simulate};

use super::Luck;

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 520.0;
/// The plot's own area.
const LEFT: f64 = 64.0;
const RIGHT: f64 = 836.0;
const TOP: f64 = 64.0;
const BOTTOM: f64 = 400.0;

const CROWDS: [u32; 9] = [1, 3, 10, 30, 100, 300, 1000, 3000, 10_000];

/// A line of the plot: jobs that differ in the number of their workers alone.
struct Line {
    name: &'static str,
    /// A colour that all eyes tell apart (after Okabe and Ito).
    colour: &'static str,
    job: Duration,
    /// Of the picture, where it is not as large as the work asks for.
    size: Option<(u32, u32)>,
    round_trip: (Duration, Duration),
    trouble: Trouble,
}

const NEAR: (Duration, Duration) = (Duration::from_micros(100), Duration::from_micros(500));
const FAR: (Duration, Duration) = (Duration::from_millis(1), Duration::from_millis(200));

fn lines() -> Vec<Line> {
    let calm = Luck::Calm.trouble();
    let minutes = |n: u64| Duration::from_secs(60 * n);
    let line = |name, colour, job, size, round_trip, trouble| Line { name, colour, job, size, round_trip, trouble };
    vec![
        line("three minutes, near, nothing goes wrong", "#00629c", minutes(3), None, NEAR, calm),
        line("one minute, near, nothing goes wrong", "#00805d", minutes(1), None, NEAR, calm),
        line("one minute, 1 to 200 ms away, much goes wrong", "#c85500", minutes(1), None, FAR, Luck::Bad.trouble()),
        line("one minute, near, 1920 × 1080 dear pixels", "#9c4f82", minutes(1), Some((1920, 1080)), NEAR, calm),
    ]
}

/// Runs everything that the plot shows, tells it, and draws it.
pub(crate) fn draw(map: &CostMap) -> String {
    super::heading();
    let lines: Vec<(Line, Vec<(u32, f64)>)> = lines()
        .into_iter()
        .map(|line| {
            println!("{}:", line.name);
            let points = CROWDS.iter().map(|workers| (*workers, run(&line, *workers, map).efficiency)).collect();
            (line, points)
        })
        .collect();
    svg(&lines)
}

fn run(line: &Line, workers: u32, map: &CostMap) -> Outcome {
    let usual = Setup::new(workers, line.job, map.clone());
    let setup = Setup {
        picture: line.size.unwrap_or(usual.picture),
        round_trip: line.round_trip,
        trouble: line.trouble,
        service: Service { measured: true, ..Service::default() },
        ..usual
    };
    let began = std::time::Instant::now();
    let outcome = simulate(&setup);
    super::tell(&setup, &outcome, began.elapsed());
    outcome
}

fn svg(lines: &[(Line, Vec<(u32, f64)>)]) -> String {
    let least = lines.iter().flat_map(|(_, points)| points).map(|(_, e)| *e).fold(1.0, f64::min);
    let floor = (10.0 * least).floor() / 10.0;
    let x = |workers: u32| LEFT + f64::from(workers).log10() / 4.0 * (RIGHT - LEFT);
    let y = |share: f64| BOTTOM - (share - floor) / (1.0 - floor) * (BOTTOM - TOP);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{HEIGHT}\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         role=\"img\" font-family=\"Roboto, 'Helvetica Neue', Arial, sans-serif\" fill=\"#22262b\">\n\
         <title>Efficiency of simulated farms</title>\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#ffffff\"/>\n"
    );
    let mut put = |element: String| {
        // Writing to a string does not fail.
        let _ = writeln!(out, "{element}");
    };
    put(text((24.0, 36.0), 20.0, "start", "Worker time that went into the picture, by the number of workers"));
    for decade in 0..=4 {
        let workers = 10_u32.pow(decade);
        put(rule((x(workers), TOP), (x(workers), BOTTOM)));
        put(text((x(workers), BOTTOM + 20.0), 13.0, "middle", &workers.to_string()));
    }
    let steps = ((1.0 - floor) * 10.0).round() as u32;
    for step in 0..=steps {
        let share = 1.0 - f64::from(step) / 10.0;
        put(rule((LEFT, y(share)), (RIGHT, y(share))));
        put(text((LEFT - 8.0, y(share) + 4.5), 13.0, "end", &format!("{:.0} %", 100.0 * share)));
    }
    for (n, (line, points)) in lines.iter().enumerate() {
        let colour = line.colour;
        let path: Vec<String> = points.iter().map(|(w, e)| format!("{:.1},{:.1}", x(*w), y(*e))).collect();
        put(format!("<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>", path.join(" ")));
        for (w, e) in points {
            put(format!("<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{colour}\"/>", x(*w), y(*e)));
        }
        let (column, row) = (n % 2, n / 2);
        let at = (LEFT + 390.0 * column as f64, BOTTOM + 54.0 + 22.0 * row as f64);
        put(format!(
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{colour}\" stroke-width=\"3\"/>",
            at.0,
            at.1 - 4.5,
            at.0 + 24.0,
            at.1 - 4.5
        ));
        put(text((at.0 + 32.0, at.1), 13.0, "start", line.name));
    }
    out.push_str("</svg>\n");
    out
}

fn text((x, y): (f64, f64), size: f64, anchor: &str, what: &str) -> String {
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" text-anchor=\"{anchor}\">{what}</text>")
}

fn rule((x1, y1): (f64, f64), (x2, y2): (f64, f64)) -> String {
    format!("<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"#e2e5e8\"/>")
}
