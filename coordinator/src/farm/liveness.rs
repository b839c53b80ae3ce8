//! When something was last heard over a connection: a sign of life that waits in no queue.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::Instant;

/// What signs of life count from.
static BEGAN: LazyLock<Instant> = LazyLock::new(Instant::now);

/// See the [module](self). Clones are the same.
#[derive(Clone, Debug, Default)]
pub(super) struct LastSign(Arc<AtomicU64>);

impl LastSign {
    /// Something was heard now.
    pub(super) fn beat(&self) {
        let since = u64::try_from(BEGAN.elapsed().as_millis()).unwrap_or(u64::MAX);
        self.0.store(since + 1, Ordering::Relaxed);
    }

    /// Milliseconds to the last beat, from the beginning of all; 0 where there was none.
    pub(super) fn last(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}
