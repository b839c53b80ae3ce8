//! Why a worker cannot work.

use crate::address::AddressError;

/// Why a worker gave up.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The coordinator does not want it, and asking again would not help.
    #[error("the coordinator refused this worker: {0}")]
    Refused(String),
    /// The coordinator's address leads nowhere.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// No threads to be had.
    #[error("cannot start {0} threads: {1}")]
    Threads(usize, String),
    /// Numbers would differ from other workers'.
    #[error("this processor is set to flush denormal numbers to zero: pictures would differ")]
    Denormals,
}
