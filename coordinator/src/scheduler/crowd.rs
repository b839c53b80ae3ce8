//! Sums over the workers that may be given leases. A worker is taken out and put in again whenever
//! something of it changes, so that no event needs a walk over all of them.

use super::WorkerKey;

/// Parts of a pixel a second in which rates are summed: whole numbers, so that what was added can be
/// taken out again to the last bit.
const RATE_PARTS: f64 = 65_536.0;

/// What one worker adds to the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Share {
    pub(super) threads: u32,
    /// Whether it is known to deliver.
    pub(super) proven: bool,
    /// Its rate, once measured.
    rate: Option<u64>,
    /// Pixels that it holds.
    pub(super) held: u64,
}

impl Share {
    /// `rate` is in pixels a second.
    pub(super) fn new(threads: u32, proven: bool, rate: Option<f64>, held: u64) -> Self {
        // Saturates.
        Self { threads, proven, rate: rate.map(|r| (r * RATE_PARTS) as u64), held }
    }
}

/// A worker's position among those with room for a lease: the fewest leases first, and of equals those that are
/// known to deliver.
pub(super) type Preference = (usize, bool, WorkerKey);

/// See the [module](self).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Crowd {
    pub(super) count: usize,
    pub(super) threads: u64,
    pub(super) proven: usize,
    pub(super) held: u64,
    measured_threads: u64,
    measured_rate: u128,
}

impl Crowd {
    pub(super) fn add(&mut self, share: &Share) {
        self.count += 1;
        self.threads += u64::from(share.threads);
        self.proven += usize::from(share.proven);
        self.held += share.held;
        if let Some(rate) = share.rate {
            self.measured_threads += u64::from(share.threads);
            self.measured_rate += u128::from(rate);
        }
    }

    pub(super) fn remove(&mut self, share: &Share) {
        self.count -= 1;
        self.threads -= u64::from(share.threads);
        self.proven -= usize::from(share.proven);
        self.held -= share.held;
        if let Some(rate) = share.rate {
            self.measured_threads -= u64::from(share.threads);
            self.measured_rate -= u128::from(rate);
        }
    }

    /// Pixels a second of a thread, over those that were measured.
    pub(super) fn rate_of_a_thread(&self) -> Option<f64> {
        (self.measured_threads > 0).then(|| self.measured_rate as f64 / RATE_PARTS / self.measured_threads as f64)
    }

    /// Pixels a second of all, where a thread that was not measured is taken to do `typical`.
    pub(super) fn rate(&self, typical: Option<f64>) -> f64 {
        let unmeasured = (self.threads - self.measured_threads) as f64;
        self.measured_rate as f64 / RATE_PARTS + unmeasured * typical.unwrap_or(0.0)
    }
}
