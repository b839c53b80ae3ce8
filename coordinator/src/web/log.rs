//! What happened, in the farm's words, for those who look at the page: the last lines of it.

use std::collections::VecDeque;
use std::fmt::Write;
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde_json::{Value, json};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;

use crate::farm::FARM;
use crate::queue::now_ms;

/// Lines that are kept.
const LINES: usize = 1000;
/// Characters of a line.
const LENGTH: usize = 500;

#[derive(Debug)]
struct Line {
    at_ms: u64,
    level: Level,
    text: String,
}

#[derive(Debug)]
struct Lines {
    lines: VecDeque<Line>,
    /// Those that came before the first that is kept.
    forgotten: u64,
}

/// As the subscriber is: one for the process.
static KEPT: Mutex<Lines> = Mutex::new(Lines { lines: VecDeque::new(), forgotten: 0 });

fn kept() -> MutexGuard<'static, Lines> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps what the farm says, and every warning, for the page.
pub fn layer<S: Subscriber + for<'a> LookupSpan<'a>>() -> impl Layer<S> {
    Keeper.with_filter(Targets::new().with_target(FARM, Level::INFO).with_target("coordinator", Level::WARN))
}

struct Keeper;

impl<S: Subscriber> Layer<S> for Keeper {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut words = Words(String::new());
        event.record(&mut words);
        let text = words.0.chars().take(LENGTH).collect();
        let line = Line { at_ms: now_ms(), level: *event.metadata().level(), text };
        let mut kept = kept();
        if kept.lines.len() >= LINES {
            kept.lines.pop_front();
            kept.forgotten += 1;
        }
        kept.lines.push_back(line);
    }
}

/// The message, and then whatever else is told with it.
struct Words(String);

impl Visit for Words {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        let _ = match field.name() {
            "message" => write!(self.0, "{value:?}"),
            name => write!(self.0, " {name}={value:?}"),
        };
    }
}

/// The number of the line that comes next.
pub(super) fn next() -> u64 {
    let kept = kept();
    kept.forgotten + kept.lines.len() as u64
}

/// The lines from number `since` on, as far as they are kept, `most` of the newest.
pub(super) fn since(since: u64, most: usize) -> Value {
    let kept = kept();
    let next = kept.forgotten + kept.lines.len() as u64;
    let first = since.clamp(kept.forgotten, next).max(next.saturating_sub(most as u64));
    let lines: Vec<Value> = kept
        .lines
        .iter()
        .skip((first - kept.forgotten) as usize)
        .map(|line| json!({ "at_ms": line.at_ms, "level": line.level.as_str().to_lowercase(), "text": line.text }))
        .collect();
    json!({ "first": first, "next": next, "lines": lines })
}

#[cfg(test)]
mod tests {
    use tracing_subscriber::layer::SubscriberExt;

    use super::*;

    #[test]
    fn the_farms_words_and_warnings_are_kept_the_last_of_them() {
        let subscriber = tracing_subscriber::registry().with(layer());
        tracing::subscriber::with_default(subscriber, || {
            tracing::info!(target: FARM, "bert joined with {} threads", 2);
            tracing::info!("nobody has to know");
            tracing::warn!(target: "coordinator::web", "it burns");
            let said = since(0, 10);
            assert_eq!(said["lines"].as_array().unwrap().len(), 2);
            assert_eq!(said["lines"][0]["text"], "bert joined with 2 threads");
            assert_eq!(said["lines"][1]["level"], "warn");
            assert_eq!((next(), since(1, 10)["lines"][0]["text"].as_str()), (2, Some("it burns")));
            (0..LINES).for_each(|n| tracing::info!(target: FARM, "line {n}"));
        });
        assert_eq!(next(), 2 + LINES as u64);
        let said = since(0, 5);
        assert_eq!((said["first"].as_u64(), said["lines"].as_array().unwrap().len()), (Some(997), 5));
        assert_eq!(since(u64::MAX, 5)["lines"].as_array().unwrap().len(), 0);
    }
}
