//! Waiting for what a test is about, and failing where it never comes.

use std::time::{Duration, Instant};

/// Longer than anything takes that tests wait for.
pub const NEVER: Duration = Duration::from_secs(120);

/// Looks again and again, until it is `so`.
///
/// # Panics
/// When it is not within [`NEVER`].
pub fn until(what: &str, so: impl FnMut() -> bool) {
    until_within((NEVER, Duration::from_millis(20)), || what.into(), so);
}

/// As [`until`], `within` a time, looking `every` so often; `what` is said where it never is so.
///
/// # Panics
/// When it is not.
pub fn until_within((within, every): (Duration, Duration), what: impl Fn() -> String, mut so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !so() {
        assert!(start.elapsed() < within, "never: {}", what());
        std::thread::sleep(every);
    }
}
