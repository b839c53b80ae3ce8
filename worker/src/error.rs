//! Why a worker cannot work.

use tessera_proto::token::NoRandomness;

/// Why a worker gave up.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The coordinator does not want it, and asking again would not help.
    #[error("the coordinator refused this worker: {0}")]
    Refused(String),
    /// There was no coordinator for too long.
    #[error("gave up: no coordinator at {address} for {} s; last: {last}", time.as_secs_f32().round())]
    GaveUp {
        /// Where one was looked for.
        address: String,
        /// For how long.
        time: std::time::Duration,
        /// What went wrong the last time.
        last: String,
    },
    /// No key can be drawn.
    #[error(transparent)]
    Randomness(#[from] NoRandomness),
    /// No threads to be had.
    #[error("cannot start {0} threads: {1}")]
    Threads(usize, String),
    /// Numbers would differ from other workers'.
    #[error("this processor is set to flush denormal numbers to zero: pictures would differ")]
    Denormals,
}
