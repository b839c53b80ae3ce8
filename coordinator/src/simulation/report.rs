//! What came of a simulated farm.

use std::time::Duration;

use super::worker::Times;

/// What a run came to. Shares are of the time that workers were there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// When the last tile was in, from the first worker's start.
    pub took: Duration,
    /// The mean over the workers there at the end of when their last tile that counts was in.
    pub mean_end: Duration,
    /// Time spent on tiles that came into the picture: what of the farm was of use.
    pub efficiency: f64,
    /// Time spent on other tiles: those of which another copy was first, and what was lost with workers.
    pub wasted: f64,
    /// Time for connecting, fetching the scene and preparing it.
    pub starting: f64,
    /// Time without a tile, while there were tiles to be had.
    pub waiting: f64,
    /// Tiles in the picture.
    pub tiles: u64,
    /// Messages that the coordinator took in.
    pub messages: u64,
    /// Bytes to the coordinator, and from it.
    pub bytes: (u64, u64),
    /// The share of the time that the coordinator was at work.
    pub load: f64,
    /// The longest that a message waited for it.
    pub longest_wait: Duration,
    /// Time that the scheduler itself took on this machine for a tile, everything counted, and the longest for one event.
    pub scheduler: Duration,
    /// The longest that it took for one event.
    pub scheduler_longest: Duration,
    /// Sessions that the coordinator ended.
    pub cut_off: u64,
}

impl Outcome {
    /// Time without a tile at the end, when there were none to be had.
    #[must_use]
    pub fn ending(&self) -> f64 {
        1.0 - self.efficiency - self.wasted - self.starting - self.waiting
    }

    /// When the last tile ended, as a multiple of when workers ended on the mean.
    #[must_use]
    pub fn tail(&self) -> f64 {
        self.took.as_secs_f64() / self.mean_end.as_secs_f64()
    }

    pub(super) fn share_out(&mut self, times: impl Iterator<Item = Times>) {
        let mut all = Times::default();
        for t in times {
            all.present += t.present;
            all.useful += t.useful;
            all.wasted += t.wasted;
            all.starting += t.starting;
            all.waiting += t.waiting;
        }
        let share = |t: Duration| t.as_secs_f64() / all.present.as_secs_f64();
        self.efficiency = share(all.useful);
        self.wasted = share(all.wasted);
        self.starting = share(all.starting);
        self.waiting = share(all.waiting);
    }
}
