//! How far a render is, and how long it will still take.

use std::time::Duration;

/// The share of a pass that tells as much of its pace as what was expected before.
const TRUSTED: f64 = 0.05;

/// See the [module](self). Times are since the render began.
#[derive(Debug, Default)]
pub(super) struct Pace {
    limit: Option<Duration>,
    /// Of the pass at hand: when it began, what it is expected to take, its work and what is done of it.
    began: Duration,
    expected: Option<Duration>,
    work: f64,
    done: f64,
    /// Whether it is for the picture, and not a look whose results say how much there will be to do.
    kept: bool,
    /// The share told last: it never falls.
    share: f64,
}

impl Pace {
    /// Of a render that ends after `limit`, if there is one.
    pub(super) fn new(limit: Option<Duration>) -> Self {
        Self { limit, ..Self::default() }
    }

    /// A pass begins.
    pub(super) fn begin(&mut self, now: Duration, work: f64, kept: bool, expected: Option<Duration>) {
        (self.began, self.work, self.done, self.kept, self.expected) = (now, work, 0.0, kept, expected);
    }

    /// Part of its work is done.
    pub(super) fn add(&mut self, work: f64) {
        self.done += work;
    }

    /// The share of the render that is done, and the time to go, as far as that can be told.
    pub(super) fn tell(&mut self, now: Duration) -> (f64, Option<Duration>) {
        let left = match self.limit {
            Some(limit) => Some(limit.saturating_sub(now).as_secs_f64()),
            None if self.kept => self.left(now),
            None => None,
        };
        if let Some(left) = left {
            let gone = now.as_secs_f64();
            let share = if gone + left > 0.0 { gone / (gone + left) } else { 0.0 };
            self.share = self.share.max(share.min(1.0));
        }
        (self.share, left.and_then(|left| Duration::try_from_secs_f64(left).ok()))
    }

    /// Seconds that the pass will still take.
    fn left(&self, now: Duration) -> Option<f64> {
        let done = if self.work > 0.0 { (self.done / self.work).min(1.0) } else { 0.0 };
        let gone = now.saturating_sub(self.began).as_secs_f64();
        let by_pace = (done > 0.0).then(|| gone / done);
        let whole = match (by_pace, self.expected.map(|e| e.as_secs_f64())) {
            (Some(pace), Some(expected)) => {
                let trust = done / (done + TRUSTED);
                trust * pace + (1.0 - trust) * expected.max(gone)
            }
            (pace, expected) => pace.or(expected)?,
        };
        Some((whole * (1.0 - done)).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn s(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    #[test]
    fn under_a_limit_it_is_the_time_left_whatever_is_done() {
        let mut pace = Pace::new(Some(s(10.0)));
        pace.begin(s(0.0), 100.0, true, None);
        pace.add(90.0);
        assert_eq!(pace.tell(s(2.5)), (0.25, Some(s(7.5))));
        assert_eq!(pace.tell(s(11.0)), (1.0, Some(s(0.0))));
    }

    #[test]
    fn looks_tell_nothing_and_renders_what_their_pace_says() {
        let mut pace = Pace::new(None);
        pace.begin(s(0.0), 10.0, false, None);
        pace.add(10.0);
        assert_eq!(pace.tell(s(1.0)), (0.0, None));
        pace.begin(s(1.0), 100.0, true, Some(s(9.0)));
        assert_eq!(pace.tell(s(1.0)), (0.1, Some(s(9.0))));
        pace.add(50.0);
        let (share, left) = pace.tell(s(6.0));
        assert!((share - 0.55).abs() < 0.02 && (4.0..5.1).contains(&left.unwrap_or_default().as_secs_f64()));
        // Once more, and longer: what was told stays.
        pace.begin(s(11.0), 100.0, true, None);
        pace.add(1.0);
        let (again, _) = pace.tell(s(12.0));
        assert!(again >= share);
    }
}
