//! How far a measurement is, on stderr.

use std::time::{Duration, Instant};

use coordinator::measure::Stage;
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval_at};

use crate::cli::console::Console;
use crate::cli::progress::{Bar, Style, duration};

/// Steps of the bar.
const STEPS: u64 = 1000;

/// Shows what `watched` says until its sender is gone.
pub(super) async fn show(style: Style, mut watched: watch::Receiver<Stage>, console: Console) {
    if style == Style::None {
        return;
    }
    let bar = (style == Style::Bar).then(|| Bar::new(&console, STEPS));
    let mut ticks = interval_at(tokio::time::Instant::now() + style.period(), style.period());
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = ticks.tick() => {}
            () = async { while watched.changed().await.is_ok() {} } => {
                // The last word of a stream that machines read; people get a table instead.
                if style == Style::Json {
                    console.say(&json(&watched.borrow(), Instant::now()));
                }
                return;
            }
        }
        let (stage, now) = (watched.borrow().clone(), Instant::now());
        match (&bar, style) {
            (Some(bar), _) => bar.set((STEPS as f64 * stage.share(now)) as u64, details(&stage, now)),
            (None, Style::Json) => console.say(&json(&stage, now)),
            (None, _) => console.say(&format!("{:3.0} %  {}", 100.0 * stage.share(now), details(&stage, now))),
        }
    }
}

/// `--samples 16  about 40 s to go`.
fn details(stage: &Stage, now: Instant) -> String {
    match stage.left(now) {
        Duration::ZERO => stage.what.clone(),
        left => format!("{}  about {} to go", stage.what, duration(left)),
    }
}

fn json(stage: &Stage, now: Instant) -> String {
    serde_json::json!({
        "event": "progress",
        "share": stage.share(now),
        "stage": stage.what,
        "elapsed_seconds": (now - stage.began).as_secs_f64(),
        "remaining_seconds": stage.left(now).as_secs_f64(),
    })
    .to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_tell_their_share_and_the_time_to_go() {
        let began = Instant::now();
        let s = Duration::from_secs;
        let since = began + s(10);
        let stage = Stage { what: "--samples 16".into(), began, since, expected: s(20), after: s(10) };
        let now = since + s(5);
        assert_eq!(details(&stage, now), "--samples 16  about 25 s to go");
        let value: serde_json::Value = serde_json::from_str(&json(&stage, now)).expect("JSON");
        assert_eq!((value["share"].as_f64(), value["remaining_seconds"].as_f64()), (Some(0.375), Some(25.0)));
        // A stage that takes longer than thought never says less than nothing.
        assert_eq!(details(&stage, since + s(90)), "--samples 16  about 10 s to go");
    }
}
