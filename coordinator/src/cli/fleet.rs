//! `coordinator fleet`, and `--fleet`: workers that an engine starts.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use coordinator::access::{Access, State};
use coordinator::fleet::{Demand, Engine, Fleet, FleetError, Keeper, Scaling, Size, TokenSource, WorkerOrder};
use coordinator::{Progress, Queue};
use tessera_proto::token::Token;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use worker::Address;

use super::access::AccessFlags;
use super::args::{self, FarmFlags, FleetFlags, OwnFleet};
use super::console::Console;
use super::exit::{Exit, Failure};
use super::farm::{Client, Reached};
use super::{render, signals};

/// Where flags say nothing else.
const GIVE_UP_AFTER: Duration = Duration::from_secs(120);
const WORTH: Duration = Duration::from_secs(20);
const IDLE: Duration = Duration::from_secs(30);
/// Between two looks at a farm that stays.
const LOOK_EVERY: Duration = Duration::from_secs(2);

fn failed(e: impl std::fmt::Display) -> Failure {
    Failure::new(Exit::Failed, e)
}

/// The fleet that the flags describe.
fn fleet(
    engine: Engine,
    flags: &FleetFlags,
    (connect, token, once): (Address, TokenSource, bool),
) -> Result<Fleet, Failure> {
    let size = flags.fleet_workers;
    let size: Size = size.ok_or_else(|| Failure::usage("how many workers? Give --fleet-workers N or MIN..MAX"))?;
    let args = flags.fleet_args.clone().unwrap_or_default();
    if args.chars().any(char::is_control) {
        return Err(Failure::usage("--fleet-args must be one line of plain text"));
    }
    let program = match &flags.fleet_program {
        Some(program) if program.is_empty() || program.chars().any(char::is_control) => {
            return Err(Failure::usage("--fleet-program names no program"));
        }
        Some(program) => program.clone(),
        None => beside(),
    };
    let order = WorkerOrder {
        program,
        connect,
        token,
        once,
        give_up_after: flags.fleet_give_up_after.unwrap_or(GIVE_UP_AFTER),
        lifetime: flags.fleet_lifetime,
    };
    let scaling = Scaling { size, worth: flags.fleet_worth.unwrap_or(WORTH), idle: flags.fleet_idle.unwrap_or(IDLE) };
    let name = Fleet::fresh_name().map_err(failed)?;
    Ok(Fleet { engine, name, order, args, scaling })
}

/// The worker beside this program, by its whole name; else whichever is found where it runs.
fn beside() -> String {
    let own = std::env::current_exe().ok();
    let path = own.and_then(|own| Some(own.parent()?.join(format!("worker{}", std::env::consts::EXE_SUFFIX))));
    path.filter(|path| path.is_file()).map_or_else(|| "worker".into(), |path| path.to_string_lossy().into_owned())
}

/// Where workers have a token from that this process has; `file` holds it.
fn source(engine: &Engine, token: Option<Token>, file: Option<PathBuf>) -> TokenSource {
    match (token, file) {
        (None, None) => TokenSource::None,
        (_, Some(file)) if !engine.hands_on_environment() => TokenSource::File(absolute(&file)),
        (Some(token), _) => TokenSource::Environment(token),
        (None, Some(file)) => TokenSource::File(absolute(&file)),
    }
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.into())
}

/// This user's own token for workers, where there is one already.
fn own_token() -> Option<PathBuf> {
    State::of_user().ok().map(|state| state.token_path()).filter(|path| path.exists())
}

/// `coordinator fleet`: workers for a farm that runs already.
pub(crate) fn run(raw: &args::Fleet, console: &Console) -> Result<Exit, Failure> {
    let variable = std::env::var("TESSERA_TOKEN").ok().filter(|text| !text.is_empty());
    let file = match (&raw.token_file, &variable) {
        (Some(file), _) => Some(file.clone()),
        (None, Some(_)) => None,
        (None, None) => own_token(),
    };
    // What is only printed needs no secret.
    let token = worker::given_token(None, file.as_deref(), variable.as_deref()).map_err(Failure::usage)?;
    let token = match &raw.token_file {
        Some(file) => TokenSource::File(absolute(file)),
        None => source(&raw.engine, token, file),
    };
    let fleet = fleet(raw.engine.clone(), &raw.flags, (raw.connect.clone(), token, false))?;
    if raw.flags.print {
        console.out(&fleet.print())?;
        return Ok(Exit::Done);
    }
    let stop = signals::stop_on_signal(console);
    render::on_runtime(1, beside_farm(raw, fleet, console, stop))
}

/// Keeps workers for a farm that somebody else runs, for as long as there is one.
async fn beside_farm(
    raw: &args::Fleet,
    fleet: Fleet,
    console: &Console,
    stop: CancellationToken,
) -> Result<Exit, Failure> {
    let patience = fleet.order.give_up_after;
    let flags = FarmFlags { farm: Some(raw.connect.clone()), user_token: raw.user_token.clone() };
    let first = look(&flags).await.map_err(|e| Failure::new(e.exit, format!("{}; is the farm there?", e.message)))?;
    let (tell, demand) = watch::channel(first);
    let keeper = Keeper::start(fleet, demand, true).map_err(failed)?;
    let mut gone_since = None;
    let ended = loop {
        tokio::select! {
            () = stop.cancelled() => break Ok(Exit::Interrupted),
            () = keeper.failed() => break Ok(Exit::Failed),
            () = tokio::time::sleep(LOOK_EVERY) => {}
        }
        match look(&flags).await {
            Ok(now) => {
                gone_since = None;
                tell.send_replace(now);
            }
            Err(e) => {
                let since = gone_since.get_or_insert_with(std::time::Instant::now);
                if since.elapsed() >= patience {
                    console.say(&format!("{}: its workers are ended", e.message));
                    break Ok(Exit::Done);
                }
            }
        }
    };
    let kept = render::blocking(move || keeper.end()).await?;
    kept.map_err(failed).and(ended)
}

/// What a farm has to do. One that renders a single picture does not say: it has work while it is there.
async fn look(flags: &FarmFlags) -> Result<Demand, Failure> {
    match Client::reach(flags).await? {
        Reached::Render => Ok(Demand { has_work: true, work: Some(f64::MAX), workers: 0, over: false }),
        Reached::Farm(mut client) => {
            let (jobs, workers) = (client.jobs().await?, client.workers().await?);
            Ok(coordinator::fleet::demand_of_jobs(jobs.iter(), workers.len()))
        }
    }
}

/// A fleet of this process's own farm, from when it is known where that listens.
pub(crate) struct Own {
    keeper: Keeper,
    demand: watch::Sender<Demand>,
}

impl OwnFleet {
    /// Checks what can be known before anything is done; whether there is a fleet.
    pub(crate) fn check(&self, listens: bool) -> Result<(), Failure> {
        match &self.fleet {
            None if self.flags.is_given() => {
                Err(Failure::usage("which engine is to start workers? Give --fleet slurm, pbs or lsf"))
            }
            Some(_) if !listens => {
                Err(Failure::usage("--fleet needs --listen ADDR, where the engine's workers reach this farm"))
            }
            _ => Ok(()),
        }
    }

    /// What would be submitted for a farm that listens as asked.
    pub(crate) async fn print(
        &self,
        listen: &str,
        access: &AccessFlags,
        (once, console): (bool, &Console),
    ) -> Result<Exit, Failure> {
        let Some(engine) = self.fleet.clone() else { return Err(Failure::usage("--print needs --fleet ENGINE")) };
        let coordinator::ListenAddr::Socket(addr) = super::options::resolve(listen).await? else {
            return Err(Failure::usage("--fleet needs --listen ADDR"));
        };
        let token = match access.asks(addr) {
            false => TokenSource::None,
            // What is printed holds no secret, so that none has to be made.
            true => access.token_file.clone().or_else(own_token).map_or(TokenSource::None, |file| {
                source(&engine, worker::given_token(None, Some(&file), None).ok().flatten(), Some(file))
            }),
        };
        let connect = self.connect(addr)?;
        console.out(&fleet(engine, &self.flags, (connect, token, once))?.print())?;
        Ok(Exit::Done)
    }

    fn connect(&self, addr: SocketAddr) -> Result<Address, Failure> {
        if let Some(connect) = &self.fleet_connect {
            return Ok(connect.clone());
        }
        if !addr.ip().is_unspecified() {
            return Ok(addr.into());
        }
        let name = format!("{}:{}", gethostname::gethostname().to_string_lossy(), addr.port());
        name.parse().map_err(|e| Failure::usage(format!("{e}; say by --fleet-connect where workers reach this farm")))
    }

    /// Starts the fleet, where one is asked for.
    pub(crate) fn start(
        &self,
        addr: SocketAddr,
        (access, flags): (&Access, &AccessFlags),
        (once, must_start): (bool, bool),
    ) -> Result<Option<Own>, Failure> {
        let Some(engine) = self.fleet.clone() else { return Ok(None) };
        if access.token().is_none() && !access.is_open() {
            return Err(Failure::usage("--fleet hands a token on: certificates of workers' own are not for it"));
        }
        let token = source(&engine, access.token(), flags.token_file.clone().or_else(own_token));
        let token = if access.is_open() { TokenSource::None } else { token };
        let fleet = fleet(engine, &self.flags, (self.connect(addr)?, token, once))?;
        let (demand, told) = watch::channel(Demand::default());
        let keeper = Keeper::start(fleet, told, must_start).map_err(failed)?;
        Ok(Some(Own { keeper, demand }))
    }
}

impl Own {
    /// Tells what there is to do.
    pub(crate) fn tell(&self, now: Demand) {
        self.demand.send_replace(now);
    }

    /// Tells it whenever a render's progress changed, until the render is over.
    pub(crate) fn follow(&self, mut progress: watch::Receiver<Progress>) {
        let demand = self.demand.clone();
        self.tell(Demand { has_work: true, ..Demand::default() });
        tokio::spawn(async move {
            while progress.changed().await.is_ok() {
                let now = Demand::of_render(&progress.borrow_and_update());
                demand.send_replace(now);
            }
            demand.send_modify(|demand| demand.over = true);
        });
    }

    /// Tells it what a queue has to do, again and again.
    pub(crate) fn follow_queue(&self, queue: Queue) {
        let demand = self.demand.clone();
        tokio::spawn(async move {
            loop {
                demand.send_replace(queue.demand());
                tokio::time::sleep(LOOK_EVERY / 4).await;
            }
        });
    }

    /// Waits until the fleet is of no use.
    pub(crate) async fn failed(&self) {
        self.keeper.failed().await;
    }

    /// Begins to end its workers.
    pub(crate) fn stop(&self) {
        self.keeper.stop();
    }

    /// Ends its workers, and waits until none is left.
    pub(crate) fn end(self) -> Result<(), Failure> {
        self.keeper.end().map_err(|e| match e {
            FleetError::Refused { .. } => Failure::new(Exit::NoWorkers, e),
            e => failed(e),
        })
    }
}
