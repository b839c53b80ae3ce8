//! Flags of fleets: workers that an engine starts.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args as ClapArgs;
use coordinator::fleet::{Engine, Size};
use worker::Address;

use super::duration;

/// How an engine starts workers.
#[derive(Clone, Debug, Default, ClapArgs)]
pub(crate) struct FleetFlags {
    /// How many workers the engine is to start: a number, or a range from which the work that is left decides (0..64)
    #[arg(long, value_name = "N|MIN..MAX", help_heading = "Fleet")]
    pub(crate) fleet_workers: Option<Size>,
    /// The engine's own options, as on its command line: "--partition=long --time=2:00:00"
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true, help_heading = "Fleet")]
    pub(crate) fleet_args: Option<String>,
    /// The worker program where the engine runs it [default: the one beside this program]
    #[arg(long, value_name = "PROGRAM", help_heading = "Fleet")]
    pub(crate) fleet_program: Option<String>,
    /// The container image that holds both programs [default: tessera:VERSION]
    #[arg(long, value_name = "IMAGE", help_heading = "Fleet")]
    pub(crate) fleet_image: Option<String>,
    /// Leave after so long; a little less than the engine's limit, where the engine does not tell it
    #[arg(long, value_name = "D", value_parser = duration, help_heading = "Fleet")]
    pub(crate) fleet_lifetime: Option<Duration>,
    /// Workers leave when they have had no coordinator for so long [default: 2m]
    #[arg(long, value_name = "D", value_parser = duration, help_heading = "Fleet")]
    pub(crate) fleet_give_up_after: Option<Duration>,
    /// Work for each that makes another worker worth starting [default: 20s]
    #[arg(long, value_name = "D", value_parser = duration, help_heading = "Fleet")]
    pub(crate) fleet_worth: Option<Duration>,
    /// Workers are ended when there has been too little work for so long [default: 30s]
    #[arg(long, value_name = "D", value_parser = duration, help_heading = "Fleet")]
    pub(crate) fleet_idle: Option<Duration>,
    /// Print what would be submitted, and do nothing else
    #[arg(long, help_heading = "Fleet")]
    pub(crate) print: bool,
}

/// Flags of `render` and `serve`.
#[derive(Clone, Debug, Default, ClapArgs)]
pub(crate) struct OwnFleet {
    /// Have workers started by slurm, pbs, lsf, kubernetes or ssh:FILE (a list of hosts), and ended with the farm; see 'coordinator fleet --help'
    #[arg(long, value_name = "ENGINE", requires = "fleet_workers", help_heading = "Fleet")]
    pub(crate) fleet: Option<Engine>,
    /// Where those workers reach this farm [default: this machine's name, and the port of --listen]
    #[arg(long, value_name = "HOST[:PORT]", requires = "fleet", help_heading = "Fleet")]
    pub(crate) fleet_connect: Option<Address>,
    #[command(flatten)]
    pub(crate) flags: FleetFlags,
}

/// Flags of `fleet`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Fleet {
    /// What starts workers: slurm, pbs, lsf, kubernetes or ssh:FILE, a list of hosts
    pub(crate) engine: Engine,
    /// The farm that they join: HOST[:PORT]
    #[arg(long, value_name = "HOST[:PORT]")]
    pub(crate) connect: Address,
    /// File with the farm's token, where workers can read it [default: what TESSERA_TOKEN holds, or this user's own]
    #[arg(long, value_name = "FILE")]
    pub(crate) token_file: Option<PathBuf>,
    /// File with the users' token, by which a farm that stays says how much there is to do [default: this user's own]
    #[arg(long, value_name = "FILE", id = "user_token_file")]
    pub(crate) user_token: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) flags: FleetFlags,
}

impl FleetFlags {
    /// Whether anything is asked for.
    pub(crate) fn is_given(&self) -> bool {
        let Self {
            fleet_workers,
            fleet_args,
            fleet_program,
            fleet_image,
            fleet_lifetime,
            fleet_give_up_after,
            fleet_worth,
            fleet_idle,
            print,
        } = self;
        let times = [fleet_lifetime, fleet_give_up_after, fleet_worth, fleet_idle];
        *print
            || fleet_workers.is_some()
            || fleet_args.is_some()
            || fleet_program.is_some()
            || fleet_image.is_some()
            || times.iter().any(|time| time.is_some())
    }
}
