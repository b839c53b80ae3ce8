//! Ids as types, so that one is never taken for another.

use std::fmt;

macro_rules! id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name(pub u64);

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }
    };
}

id! {
    /// One registration of a worker, until its stream ends. Drawn at random.
    SessionId
}
id! {
    /// One lease of one region; never used twice by a coordinator.
    LeaseId
}
id! {
    /// One job as the farm's workers know it, below [`JobNumber::END`]; a job that is begun anew gets another number.
    JobNumber
}
id! {
    /// One worker from its start to its end, over all its sessions. Drawn at random.
    InstanceId
}

/// Bits of a lease that are its number within its job.
const WITHIN_JOB: u32 = 36;

impl JobNumber {
    /// All numbers are below.
    pub const END: u64 = 1 << 27;

    /// The lease of this job that has the number `within` it.
    #[must_use]
    pub fn lease(self, within: u64) -> LeaseId {
        LeaseId(self.0 << WITHIN_JOB | within)
    }
}

impl LeaseId {
    /// The job that it is of.
    #[must_use]
    pub fn job(self) -> JobNumber {
        JobNumber(self.0 >> WITHIN_JOB & (JobNumber::END - 1))
    }
}

/// How often a region had been leased before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Attempt(pub u32);

/// Which of the passes over a picture, counted from 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PassNumber(pub u32);

/// SHA-256 over a scene's binary form: the same for equal scenes.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SceneHash(pub [u8; 32]);

impl fmt::Debug for SceneHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl fmt::Display for SceneHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0[..8].iter().try_for_each(|b| write!(f, "{b:02x}"))
    }
}
