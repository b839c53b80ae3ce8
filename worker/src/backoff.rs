//! How long to wait before dialling again.

use std::time::Duration;

/// Exponential waits with jitter: many workers that lost one coordinator should not all
/// come back at once. Nor should a coordinator that is back wait long for them.
#[derive(Clone, Copy, Debug)]
pub struct Backoff {
    /// The first wait, at most.
    pub first: Duration,
    /// The longest wait: a coordinator that comes back is found so soon.
    pub longest: Duration,
}

impl Default for Backoff {
    fn default() -> Self {
        Self { first: Duration::from_millis(200), longest: Duration::from_secs(4) }
    }
}

impl Backoff {
    /// The waits from the first on.
    #[must_use]
    pub(crate) fn start(&self) -> Waits {
        Waits { next: self.first, longest: self.longest }
    }
}

/// Waits that grow.
#[derive(Debug)]
pub(crate) struct Waits {
    next: Duration,
    longest: Duration,
}

impl Waits {
    /// Between half and the whole of a time that doubles.
    pub(crate) fn next(&mut self) -> Duration {
        let wait = self.next.min(self.longest);
        self.next = (wait * 2).min(self.longest);
        wait.mul_f64(0.5 + 0.5 * fastrand::f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_the_longest_and_vary() {
        let mut waits = Backoff { first: Duration::from_millis(100), longest: Duration::from_millis(1000) }.start();
        for most in [100, 200, 400, 800, 1000, 1000] {
            let (wait, most) = (waits.next(), Duration::from_millis(most));
            assert!(wait >= most / 2 && wait <= most, "{wait:?}");
        }
    }
}
