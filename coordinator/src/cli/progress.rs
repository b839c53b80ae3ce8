//! How far a render is, on stderr.

use std::io::IsTerminal;
use std::path::Path;
use std::time::Duration;

use coordinator::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval_at};

use super::args::ProgressArg;
use super::console::Console;
use super::events::Events;

/// Steps of a bar.
const STEPS: u64 = 1000;

/// Looks for events to each line about progress.
const LOOKS: u32 = 10;

/// What `--progress` comes to here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Style {
    Bar,
    Plain,
    Json,
    None,
}

impl Style {
    /// The style asked for; `auto` is a bar where stderr is a terminal.
    pub(crate) fn of(arg: ProgressArg) -> Self {
        match arg {
            ProgressArg::Auto if std::io::stderr().is_terminal() => Self::Bar,
            ProgressArg::Auto | ProgressArg::Plain => Self::Plain,
            ProgressArg::Bar => Self::Bar,
            ProgressArg::Json => Self::Json,
            ProgressArg::None => Self::None,
        }
    }

    /// Between two words.
    pub(crate) fn period(self) -> Duration {
        match self {
            Self::Bar => Duration::from_millis(100),
            Self::Plain => Duration::from_secs(10),
            Self::Json => Duration::from_secs(1),
            Self::None => Duration::MAX,
        }
    }
}

/// Shows what `watched` says until its sender is gone.
pub(crate) async fn show(style: Style, mut watched: watch::Receiver<Progress>, console: Console) {
    if style == Style::None {
        return;
    }
    let (mut events, mut looks) = (Events::default(), 0u32);
    let bar = (style == Style::Bar).then(|| Bar::new(&console, STEPS));
    // Events are told soon, how far it is at every tenth look.
    let period = if style == Style::Json { style.period() / LOOKS } else { style.period() };
    let mut ticks = interval_at(Instant::now() + period, period);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = ticks.tick() => {}
            gone = async { while watched.changed().await.is_ok() {} } => {
                let () = gone;
                // The last word of a stream that machines read; people get a summary instead.
                if style == Style::Json {
                    let last = watched.borrow().clone();
                    events.since(&last).iter().for_each(|event| console.say(&event.to_string()));
                    console.say(&json(&last));
                }
                return;
            }
        }
        let now = watched.borrow().clone();
        match (&bar, style) {
            (Some(bar), _) => {
                bar.set((STEPS as f64 * now.share) as u64, details(&now));
            }
            (None, Style::Json) => {
                events.since(&now).iter().for_each(|event| console.say(&event.to_string()));
                looks += 1;
                if looks.is_multiple_of(LOOKS) {
                    console.say(&json(&now));
                }
            }
            (None, _) => console.say(&format!("{:3.0} %  {}", 100.0 * now.share, details(&now))),
        }
    }
}

/// A bar that takes itself off the screen.
pub(crate) struct Bar(ProgressBar);

impl Bar {
    /// An empty bar of `length` steps.
    pub(crate) fn new(console: &Console, length: u64) -> Self {
        let bar = console.bars().add(ProgressBar::new(length));
        // Falls back to the crate's own look, should the template ever not parse.
        if let Ok(style) = ProgressStyle::with_template("{bar:24.cyan/blue} {percent:>3} %  {wide_msg}") {
            bar.set_style(style.progress_chars("━╸─"));
        }
        Self(bar)
    }

    /// Shows so many steps, and a message beside them.
    pub(crate) fn set(&self, steps: u64, message: String) {
        self.0.set_position(steps);
        self.0.set_message(message);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

fn connected(p: &Progress) -> usize {
    p.workers.iter().filter(|w| w.connected).count()
}

fn mega_rays_per_second(p: &Progress) -> f64 {
    let (seconds, rays) = (p.elapsed.as_secs_f64(), p.rays.total().saturating_sub(p.earlier.rays.total()));
    if seconds > 0.0 { rays as f64 / seconds / 1e6 } else { 0.0 }
}

/// `pass 3: 12/48 tiles  21.3 Mrays/s  2 workers  5 s to go`.
fn details(p: &Progress) -> String {
    let workers = match connected(p) {
        0 => "waiting for workers".into(),
        1 => "1 worker".into(),
        n => format!("{n} workers"),
    };
    let to_go = p.remaining.map_or_else(String::new, |d| format!("  {} to go", duration(d)));
    let pass = match (p.pass, p.is_look) {
        (pass, true) => format!("look {pass}: "),
        (0 | 1, false) => String::new(),
        (pass, false) => format!("pass {pass}: "),
    };
    let (done, total) = (p.tiles_done, p.tiles_total);
    format!("{pass}{done}/{total} tiles  {:.1} Mrays/s  {workers}{to_go}", mega_rays_per_second(p))
}

/// A duration as a person says it.
pub(crate) fn duration(d: Duration) -> String {
    let s = d.as_secs();
    match s {
        0 if d.as_millis() < 100 => format!("{} ms", d.as_millis()),
        0..10 => format!("{:.1} s", d.as_secs_f64()),
        10..60 => format!("{s} s"),
        60..3600 => format!("{} min {} s", s / 60, s % 60),
        _ => format!("{} h {} min", s / 3600, s / 60 % 60),
    }
}

fn json(p: &Progress) -> String {
    serde_json::json!({
        "event": "progress",
        "share": p.share,
        "pass": p.pass,
        "look": p.is_look,
        "tiles_done": p.tiles_done,
        "tiles_total": p.tiles_total,
        "pixels_done": p.pixels_done,
        "pixels_total": p.pixels_total,
        "rays": p.rays.total(),
        "mrays_per_second": mega_rays_per_second(p),
        "workers": connected(p),
        "elapsed_seconds": p.elapsed.as_secs_f64(),
        "remaining_seconds": p.remaining.map(|d| d.as_secs_f64()),
    })
    .to_string()
}

/// What is said first where an earlier run did a share of the pass of this number, from 0.
pub(crate) fn going_on(style: ProgressArg, (share, pass): (f64, u32)) -> Option<String> {
    let percent = (100.0 * share).floor();
    match (style, pass) {
        (ProgressArg::None, _) => None,
        (ProgressArg::Json, _) => {
            Some(serde_json::json!({ "event": "going_on", "share": share, "pass": pass }).to_string())
        }
        (_, 0) => Some(format!("going on: {percent} % was done")),
        (_, n) => Some(format!("going on: {percent} % of pass {} was done", n + 1)),
    }
}

/// The last line of a stream of JSON: the picture is whole.
pub(crate) fn done_json(output: &Path, total: Duration) -> String {
    serde_json::json!({
        "event": "done",
        "output": output.display().to_string(),
        "elapsed_seconds": total.as_secs_f64(),
    })
    .to_string()
}

#[cfg(test)]
mod tests {
    use coordinator::{Earlier, WorkerStats};
    use tessera_core::trace::RayCounts;

    use super::*;

    fn half_way() -> Progress {
        Progress {
            pass: 1,
            is_look: false,
            share: 0.25,
            remaining: Some(Duration::from_secs(12)),
            tiles_done: 3,
            tiles_total: 9,
            pixels_done: 25,
            pixels_total: 100,
            rays: RayCounts { camera: 10_000_000, mirror: 0, shadow: 10_000_000, refined: 5, unresolved: 0 },
            earlier: Earlier::default(),
            error: None,
            workers: vec![
                WorkerStats { connected: true, ..WorkerStats::default() },
                WorkerStats { connected: false, ..WorkerStats::default() },
            ],
            elapsed: Duration::from_secs(4),
        }
    }

    #[test]
    fn a_line_says_tiles_speed_workers_and_time_to_go() {
        assert_eq!(details(&half_way()), "3/9 tiles  5.0 Mrays/s  1 worker  12 s to go");
        let passes = |is_look| details(&Progress { pass: 2, is_look, ..half_way() });
        assert!(passes(true).starts_with("look 2: 3/9 tiles") && passes(false).starts_with("pass 2: 3/9 tiles"));
        assert_eq!(details(&Progress::default()), "0/0 tiles  0.0 Mrays/s  waiting for workers");
    }

    #[test]
    fn durations_read_well() {
        let said: Vec<String> =
            [0.0421, 0.5, 9.96, 59.9, 61.0, 7322.0].map(|s| duration(Duration::from_secs_f64(s))).to_vec();
        assert_eq!(said, ["42 ms", "0.5 s", "10.0 s", "59 s", "1 min 1 s", "2 h 2 min"]);
    }

    #[test]
    fn json_lines_are_json() {
        let value: serde_json::Value = serde_json::from_str(&json(&half_way())).unwrap();
        assert_eq!((value["share"].as_f64(), value["remaining_seconds"].as_f64()), (Some(0.25), Some(12.0)));
        assert!(
            serde_json::from_str::<serde_json::Value>(&json(&Progress::default())).unwrap()["remaining_seconds"]
                .is_null()
        );
    }
}
