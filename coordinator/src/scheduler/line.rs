//! What the way to a worker and back can carry.
//!
//! What a delivery took beyond its rendering is its *lag*: the way there and back, and what waited on the way.
//! Where lags rise above the least that was seen, more is on its way than the line carries, and less is
//! sent: a control by delay, as in TCP Vegas (Brakmo and Peterson, 1995).

use std::time::Duration;

use super::Model;

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Line {
    /// Pixels that may be on their way; `None` where there is no way, as within one process.
    window: Option<f64>,
    least: f64,
    /// Waiting that is no trouble yet.
    wait: Duration,
    /// Lag of late, and the least of all.
    lag: Duration,
    quickest: Option<Duration>,
    /// Since when the window is what it is after it was narrowed; `None` where it never was.
    narrowed: Option<Duration>,
}

impl Line {
    pub(super) fn new(in_process: bool, bytes_per_pixel: u64, model: &Model) -> Self {
        let pixels = |bytes: u64| (bytes / bytes_per_pixel.max(1)) as f64;
        let window = (!in_process).then(|| pixels(model.first_bytes));
        let (least, lag) = (pixels(model.least_bytes), Duration::ZERO);
        Self { window, least, wait: model.wait, lag, quickest: None, narrowed: None }
    }

    /// Learns from a delivery of a lease given at `granted`. `in_use`: as much was on its way as may be.
    pub(super) fn arrived(&mut self, lag: Duration, granted: Duration, in_use: bool, now: Duration) {
        self.lag = if self.quickest.is_none() { lag } else { (self.lag + lag) / 2 };
        let quickest = self.quickest.map_or(lag, |q| q.min(lag));
        self.quickest = Some(quickest);
        let Some(window) = &mut self.window else { return };
        if lag > quickest + self.wait {
            // What was on its way already when it was narrowed says nothing about that.
            if self.narrowed.is_none_or(|at| granted >= at) {
                *window = (*window / 2.0).max(self.least);
                self.narrowed = Some(now);
            }
        } else if in_use {
            *window = (*window * if self.narrowed.is_some() { 1.1 } else { 2.0 }).min(1e12);
        }
    }

    /// Pixels that may be on their way together.
    pub(super) fn window(&self) -> Option<f64> {
        self.window
    }

    /// What a delivery takes beyond its rendering.
    pub(super) fn lag(&self) -> Duration {
        self.lag
    }

    /// Whether more was on its way at some time than the line carries.
    pub(super) fn is_narrow(&self) -> bool {
        self.narrowed.is_some()
    }

    /// Whether more seemed to be on its way of late than the line carries.
    pub(super) fn is_full(&self) -> bool {
        self.window.is_some() && self.quickest.is_some_and(|q| self.lag > q + self.wait)
    }

    /// Pixels a second of a worker that renders `rate`, by way of this line.
    pub(super) fn pace(&self, rate: f64) -> f64 {
        match (self.window, self.narrowed) {
            (Some(window), Some(_)) => rate.min(window / self.lag.as_secs_f64().max(1e-3)),
            _ => rate,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::MODEL;
    use super::*;

    /// A line of so many bytes a second and this delay, over which a worker always has as much on its way as
    /// it may: gives the window and what waits on the way in the end.
    fn run(bytes_per_second: f64, delay: Duration) -> (f64, Duration) {
        let mut line = Line::new(false, 12, &MODEL);
        let (mut now, mut free) = (Duration::ZERO, Duration::ZERO);
        let mut queue = std::collections::VecDeque::new();
        let mut on_the_way = 0.0;
        for _ in 0..400 {
            let window = line.window().unwrap();
            while on_the_way == 0.0 || on_the_way + window / 2.0 <= window {
                let pixels = (window / 2.0).min(65_536.0);
                free = free.max(now + delay / 2) + Duration::from_secs_f64(12.0 * pixels / bytes_per_second);
                queue.push_back((now, free + delay / 2, pixels));
                on_the_way += pixels;
                if pixels < window / 2.0 && queue.len() >= 32 {
                    break;
                }
            }
            let (granted, arrives, pixels) = queue.pop_front().unwrap();
            now = arrives;
            on_the_way -= pixels;
            line.arrived(now - granted, granted, true, now);
        }
        (line.window().unwrap(), line.lag())
    }

    #[test]
    fn a_slow_line_is_given_what_it_carries() {
        let (window, lag) = run(125_000.0, Duration::from_millis(20));
        // A second's worth is 10,417 pixels.
        assert!(window > 1_000.0 && window < 12_000.0, "{window} pixels");
        assert!(lag < Duration::from_millis(1200), "{lag:?}");
    }

    #[test]
    fn a_long_quick_line_is_not_taken_for_a_slow_one() {
        let (window, lag) = run(125_000_000.0, Duration::from_millis(200));
        assert!(window > 2_000_000.0, "{window} pixels");
        assert!(lag < Duration::from_millis(600), "{lag:?}");
    }

    #[test]
    fn within_a_process_there_is_no_window() {
        let mut line = Line::new(true, 12, &MODEL);
        line.arrived(Duration::from_secs(9), Duration::ZERO, true, Duration::from_secs(9));
        line.arrived(Duration::from_secs(99), Duration::ZERO, true, Duration::from_secs(9));
        assert!(line.window().is_none() && !line.is_full());
        assert_eq!(line.pace(5.0), 5.0);
    }
}
