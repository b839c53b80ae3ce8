//! Workers placed by the engines that manage other people's machines: batch systems, Kubernetes, a list of hosts.
//!
//! A [`Fleet`] is what an engine is to start, how many of it, and for whom. [`Fleet::print`] says what would be
//! submitted; [`keep`](keeper::keep) holds as many workers as the work that is left is worth ([`scale`]), and
//! leaves none behind. Whatever ends the coordinator itself, workers leave once there has been none for
//! [`WorkerOrder::give_up_after`].

mod batch;
mod call;
mod demand;
mod engine;
mod keeper;
mod scale;
mod script;

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use tessera_proto::token::{NoRandomness, Token, random};
use worker::Address;

pub use demand::demand_of_jobs;
pub use keeper::{FleetError, Keeper};
pub use scale::{Demand, Scaling, Size};

/// What starts workers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Engine {
    /// A batch system, by its commands.
    Batch(&'static engine::Batch),
}

/// Not the name of an engine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no engine {0:?}; there are slurm, pbs and lsf")]
pub struct UnknownEngine(String);

impl FromStr for Engine {
    type Err = UnknownEngine;

    fn from_str(text: &str) -> Result<Self, UnknownEngine> {
        let batch = engine::ALL.into_iter().find(|batch| batch.name == text);
        batch.map(Self::Batch).ok_or_else(|| UnknownEngine(text.into()))
    }
}

impl Engine {
    /// Whether workers have the environment of whoever submits them, and nobody else is shown it.
    #[must_use]
    pub fn hands_on_environment(&self) -> bool {
        match self {
            Self::Batch(batch) => batch.hands_on_environment,
        }
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Batch(batch) => f.write_str(batch.name),
        }
    }
}

/// Where workers have the farm's token from. It is never part of a command line.
#[derive(Clone, Debug, Default)]
pub enum TokenSource {
    /// The farm asks for none.
    #[default]
    None,
    /// A file that they can read where they run.
    File(PathBuf),
    /// It is handed to the engine in the environment, and by it to them.
    Environment(Token),
}

/// What every worker of a fleet is told.
#[derive(Clone, Debug)]
pub struct WorkerOrder {
    /// The program, as it is called where it runs.
    pub program: String,
    /// The farm.
    pub connect: Address,
    /// How it is let in.
    pub token: TokenSource,
    /// Whether it leaves when there is no more work.
    pub once: bool,
    /// After how long without a coordinator it leaves.
    pub give_up_after: Duration,
    /// How long it stays, where the engine does not tell its own limit.
    pub lifetime: Option<Duration>,
}

/// Workers that an engine starts for a farm.
#[derive(Clone, Debug)]
pub struct Fleet {
    /// What starts them.
    pub engine: Engine,
    /// What its jobs are called: no other fleet's are called so.
    pub name: String,
    /// What they are told.
    pub order: WorkerOrder,
    /// The engine's own options, as they are written on its command line.
    pub args: String,
    /// How many, and when.
    pub scaling: Scaling,
}

impl Fleet {
    /// A name that no other fleet has.
    ///
    /// # Errors
    /// When the system gives no random numbers.
    pub fn fresh_name() -> Result<String, NoRandomness> {
        // Short enough for every engine; of ten thousand fleets at once, two are hardly called the same.
        Ok(format!("tessera-{:08x}", u32::from_be_bytes(random()?)))
    }

    /// What would be submitted for its first workers, to be handed to the engine by hand.
    #[must_use]
    pub fn print(&self) -> String {
        let count = self.scaling.size.max;
        match &self.engine {
            Engine::Batch(batch) => script::array(batch, self, count),
        }
    }
}

/// A time as the worker's flags have it.
fn seconds(time: Duration) -> String {
    format!("{}s", time.as_secs_f64())
}

/// `text` as one word of a POSIX shell.
fn quoted(text: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_./:=,@%+".contains(&b);
    if !text.is_empty() && text.bytes().all(plain) { text.into() } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn engines_have_names() {
        for name in ["slurm", "pbs", "lsf"] {
            assert_eq!(name.parse::<Engine>().unwrap().to_string(), name);
        }
        assert!("sge".parse::<Engine>().is_err_and(|e| e.to_string().contains("slurm")));
    }

    #[test]
    fn words_reach_a_shell_as_they_are() {
        assert_eq!(quoted("/usr/bin/worker"), "/usr/bin/worker");
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's $HOME"), r"'it'\''s $HOME'");
        assert_eq!(quoted(""), "''");
    }
}
