//! Workers placed by the engines that manage other people's machines: batch systems, Kubernetes, a list of hosts.
//!
//! A [`Fleet`] is what an engine is to start, how many of it, and for whom. [`Fleet::print`] says what would be
//! submitted; a [`Keeper`] holds as many workers as the work that is left is worth ([`Scaling`]), and
//! leaves none behind. Whatever ends the coordinator itself, workers leave once there has been none for
//! [`WorkerOrder::give_up_after`].

mod batch;
mod call;
mod cluster;
mod demand;
mod engine;
mod keeper;
mod placement;
mod scale;
mod script;
mod ssh;

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use tessera_proto::token::{NoRandomness, Token, random};
use worker::Address;

pub use cluster::{InCluster, MOST_SCENE_BYTES};
pub use demand::demand_of_jobs;
pub use keeper::{FleetError, Keeper};
pub use scale::{Demand, Scaling, Size};

/// What starts workers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Engine {
    /// A batch system, by its commands.
    Batch(&'static engine::Batch),
    /// Hosts of the list in this file, over `ssh`.
    Ssh(PathBuf),
    /// A cluster that `kubectl` reaches.
    Kubernetes,
}

/// Not the name of an engine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no engine {0:?}; there are slurm, pbs, lsf, kubernetes and ssh:FILE, a list of hosts")]
pub struct UnknownEngine(String);

impl FromStr for Engine {
    type Err = UnknownEngine;

    fn from_str(text: &str) -> Result<Self, UnknownEngine> {
        match text.strip_prefix("ssh:") {
            Some(path) if !path.is_empty() => return Ok(Self::Ssh(path.into())),
            _ if text == "kubernetes" => return Ok(Self::Kubernetes),
            _ => {}
        }
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
            // It goes down the line, or into a Secret.
            Self::Ssh(_) | Self::Kubernetes => true,
        }
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Batch(batch) => f.write_str(batch.name),
            Self::Ssh(_) => f.write_str("ssh"),
            Self::Kubernetes => f.write_str("kubernetes"),
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

impl TokenSource {
    /// Whether the farm asks for one.
    #[must_use]
    pub fn is_some(&self) -> bool {
        !matches!(self, Self::None)
    }
}

/// The worker program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Program {
    /// As it is called where it runs.
    Given(String),
    /// The one of this build: here it is this file.
    Own(String),
}

impl Program {
    fn is_given(&self) -> bool {
        matches!(self, Self::Given(_))
    }
}

/// What every worker of a fleet is told.
#[derive(Clone, Debug)]
pub struct WorkerOrder {
    /// The program.
    pub program: Program,
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
    /// The container image with both programs.
    pub image: String,
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

    /// The worker program as it is called where it runs, if it lies there as it does here.
    fn program_there(&self) -> String {
        match &self.order.program {
            Program::Given(program) | Program::Own(program) => program.clone(),
        }
    }

    /// What would be submitted for all its workers, to be handed to the engine by hand.
    ///
    /// # Errors
    /// When a list of hosts cannot be read.
    pub fn print(&self) -> Result<String, String> {
        match &self.engine {
            Engine::Batch(batch) => Ok(script::array(batch, self, self.scaling.size.max)),
            Engine::Ssh(path) => Ok(ssh::print(self, &ssh::hosts(path)?)),
            Engine::Kubernetes => Ok(cluster::print(self)),
        }
    }

    /// Manifests of a whole farm in a cluster, its coordinator included.
    ///
    /// # Errors
    /// When no secrets can be made.
    pub fn print_farm(&self, farm: &InCluster) -> Result<String, String> {
        cluster::print_farm(self, farm).map_err(|e| e.to_string())
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
