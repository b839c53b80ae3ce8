//! Where a fleet's workers are placed, whatever the engine.

use super::batch::BatchJobs;
use super::call::CallError;
use super::ssh::Hosts;
use super::{Engine, Fleet};

/// What an engine has of a fleet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Standing {
    /// Workers that wait to be started, and why, as far as the engine says.
    pub(super) waiting: Vec<(String, Option<String>)>,
    /// Workers that it started.
    pub(super) running: Vec<String>,
}

impl Standing {
    pub(super) fn count(&self) -> usize {
        self.waiting.len() + self.running.len()
    }
}

/// See the [module](self).
#[derive(Debug)]
pub(super) enum Placement {
    Batch(BatchJobs),
    Hosts(Hosts),
    Cluster(super::cluster::Cluster),
}

impl Placement {
    pub(super) fn new(engine: &Engine) -> Result<Self, CallError> {
        Ok(match engine {
            Engine::Batch(batch) => Self::Batch(BatchJobs::new(batch)),
            Engine::Ssh(path) => Self::Hosts(Hosts::new(path).map_err(CallError::Refused)?),
            Engine::Kubernetes => Self::Cluster(super::cluster::Cluster::default()),
        })
    }

    /// Has `count` more workers started; `held` are there or awaited. Some may be there although it fails.
    pub(super) async fn add(&mut self, fleet: &Fleet, (held, count): (usize, usize)) -> Result<(), CallError> {
        match self {
            Self::Batch(jobs) => jobs.add(fleet, count).await,
            Self::Hosts(hosts) => hosts.add(fleet, count).await,
            Self::Cluster(cluster) => cluster.scale(fleet, held + count).await,
        }
    }

    /// What is there now.
    pub(super) async fn standing(&mut self, fleet: &Fleet) -> Result<Standing, CallError> {
        match self {
            Self::Batch(jobs) => jobs.standing(fleet).await,
            Self::Hosts(hosts) => Ok(hosts.standing().await),
            Self::Cluster(cluster) => cluster.standing(fleet).await,
        }
    }

    /// Ends workers; `left` are to stay.
    pub(super) async fn remove(&mut self, fleet: &Fleet, workers: &[String], left: usize) -> Result<(), CallError> {
        match self {
            Self::Batch(jobs) => jobs.remove(workers).await,
            Self::Hosts(hosts) => {
                hosts.remove(Some(workers));
                Ok(())
            }
            Self::Cluster(cluster) => cluster.scale(fleet, left).await,
        }
    }

    /// Ends all.
    pub(super) async fn remove_all(&mut self, fleet: &Fleet) -> Result<(), CallError> {
        match self {
            Self::Batch(jobs) => jobs.remove_all(fleet).await,
            Self::Hosts(hosts) => {
                hosts.remove(None);
                Ok(())
            }
            Self::Cluster(cluster) => cluster.remove_all(fleet).await,
        }
    }

    /// What to type to end all.
    pub(super) fn remedy(&self, fleet: &Fleet) -> String {
        match self {
            Self::Batch(jobs) => jobs.remedy(fleet),
            Self::Hosts(_) => "ending the workers on the hosts".into(),
            Self::Cluster(_) => super::cluster::remedy(fleet),
        }
    }
}
