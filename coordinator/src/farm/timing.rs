//! How long things may take.

use std::time::Duration;

/// Times by which a farm lives.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Between two heartbeats of a worker.
    pub beat: Duration,
    /// Silence that makes a worker suspect.
    pub suspect_after: Duration,
    /// Silence that ends a worker's session.
    pub dead_after: Duration,
    /// How long a worker may take to fetch and prepare the scene.
    pub prepare_within: Duration,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            beat: Duration::from_millis(500),
            suspect_after: Duration::from_secs(2),
            dead_after: Duration::from_secs(5),
            prepare_within: Duration::from_secs(600),
        }
    }
}
