//! `coordinator fleet`, and `--fleet`: workers that an engine starts.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use coordinator::access::{Access, State};
use coordinator::fleet::{
    Demand, Engine, Fleet, FleetError, InCluster, Keeper, MOST_SCENE_BYTES, Program, Scaling, Size, TokenSource,
    WorkerOrder,
};
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
use super::options::resolve;
use super::runtime::{blocking, on_runtime};
use super::{scene, signals};

/// Where flags say nothing else.
const GIVE_UP_AFTER: Duration = Duration::from_secs(120);
const WORTH: Duration = Duration::from_secs(20);
const IDLE: Duration = Duration::from_secs(30);
/// Stands for an address that is known later.
const LATER: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 4747);
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
    if matches!(token, TokenSource::Environment(_)) && !engine.hands_on_environment() {
        return Err(Failure::usage(format!(
            "{engine} shows the environment of a job to others: give the token by --token-file, where workers can read it"
        )));
    }
    let program = match &flags.fleet_program {
        Some(program) if program.is_empty() || program.chars().any(char::is_control) => {
            return Err(Failure::usage("--fleet-program names no program"));
        }
        Some(program) => Program::Given(program.clone()),
        None => Program::Own(beside()),
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
    let image = flags.fleet_image.clone().unwrap_or_else(|| concat!("tessera:", env!("CARGO_PKG_VERSION")).into());
    Ok(Fleet { engine, name, order, args, image, scaling })
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

/// This user's own token as a user of farms, where there is one already.
fn own_user_token() -> Option<PathBuf> {
    State::of_user().ok().map(|state| state.user_token_path()).filter(|path| path.exists())
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
        console.out(&fleet.print().map_err(Failure::usage)?)?;
        return Ok(Exit::Done);
    }
    let stop = signals::stop_on_signal(console);
    on_runtime(1, beside_farm(raw, fleet, console, stop))
}

/// Keeps workers for a farm that somebody else runs, for as long as there is one.
async fn beside_farm(
    raw: &args::Fleet,
    fleet: Fleet,
    console: &Console,
    stop: CancellationToken,
) -> Result<Exit, Failure> {
    let patience = fleet.order.give_up_after;
    // Where there is no users' token, the workers' at least tells whether this is the farm.
    let user_token = raw.user_token.clone().or_else(own_user_token).or_else(|| raw.token_file.clone());
    let user_token = user_token.filter(|_| fleet.order.token.is_some());
    let flags = FarmFlags { farm: Some(raw.connect.clone()), user_token };
    let mut asks = true;
    let first = look(&flags, &mut asks)
        .await
        .map_err(|e| Failure::new(e.exit, format!("{}; is the farm there?", e.message)))?;
    if !asks {
        let most = fleet.scaling.size.max;
        tracing::info!(target: "farm", "the farm does not tell how much there is to do: it gets {most} workers");
    }
    let (tell, demand) = watch::channel(first);
    let keeper = Keeper::start(fleet, demand, true).map_err(failed)?;
    let mut gone_since = None;
    let ended = loop {
        tokio::select! {
            () = stop.cancelled() => break Ok(Exit::Interrupted),
            () = keeper.failed() => break Ok(Exit::Failed),
            () = tokio::time::sleep(LOOK_EVERY) => {}
        }
        match look(&flags, &mut asks).await {
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
    let kept = blocking(move || keeper.end()).await?;
    kept.map_err(failed).and(ended)
}

/// What a farm has to do. One that does not tell has work while it is there, and is not asked again.
async fn look(flags: &FarmFlags, asks: &mut bool) -> Result<Demand, Failure> {
    let reached = Client::reach(flags, *asks).await?;
    *asks = matches!(reached, Reached::Farm(_));
    match reached {
        Reached::Silent => Ok(Demand { has_work: true, work: Some(f64::MAX), workers: 0, over: false }),
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
    /// What would be submitted for a farm that listens as asked.
    pub(crate) async fn print(
        &self,
        listen: &str,
        access: &AccessFlags,
        (inside, once, console): (impl FnOnce() -> Result<InCluster, Failure>, bool, &Console),
    ) -> Result<Exit, Failure> {
        let Some(engine) = self.fleet.clone() else { return Err(Failure::usage("--print needs --fleet ENGINE")) };
        if engine == Engine::Kubernetes {
            let mut fleet = fleet(engine, &self.flags, (worker::Address::from(LATER), TokenSource::None, false))?;
            fleet.order.connect = fleet.name.parse().map_err(failed)?;
            // Known by then: it is in the same Secret.
            fleet.order.token = TokenSource::File(PathBuf::new());
            console.out(&fleet.print_farm(&inside()?).map_err(failed)?)?;
            return Ok(Exit::Done);
        }
        let coordinator::ListenAddr::Socket(addr) = resolve(listen).await? else {
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
        let fleet = fleet(engine, &self.flags, (connect, token, once))?;
        console.out(&fleet.print().map_err(Failure::usage)?)?;
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

/// A scene as a coordinator in a cluster is given it: the text itself, with the picture's flags as they were typed.
pub(super) fn scene_in_cluster(file: &Path, output: &Path) -> Result<InCluster, Failure> {
    let elsewhere = "have it stay in the cluster by 'coordinator serve --fleet kubernetes --print', and submit to it";
    let read = scene::read(file, Vec::new());
    if read.scene.is_none() {
        let name = file.display();
        return Err(Failure::new(Exit::Scene, format!("'{name}' is not valid; 'coordinator check {name}' says why")));
    }
    if !read.pictures.is_empty() {
        return Err(Failure::usage(format!("a scene with pictures does not go into a manifest: {elsewhere}")));
    }
    let text = std::fs::read_to_string(file).map_err(|e| Failure::usage(format!("'{}': {e}", file.display())))?;
    if text.len() > MOST_SCENE_BYTES {
        return Err(Failure::usage(format!(
            "a scene of {} bytes is too large for a manifest: {elsewhere}",
            text.len()
        )));
    }
    let named = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let name = named(file).chars().map(plain).collect();
    Ok(InCluster::Render { name, text, flags: picture_flags(), output: named(output) })
}

/// What was said about the picture on this process's command line.
fn picture_flags() -> Vec<String> {
    use clap::CommandFactory;
    use clap::parser::ValueSource;
    let command = args::Args::command();
    let render = command.find_subcommand("render").cloned().unwrap_or_default();
    let Ok(matches) = command.try_get_matches_from(std::env::args_os()) else { return Vec::new() };
    let Some((_, given)) = matches.subcommand() else { return Vec::new() };
    let mut flags = Vec::new();
    for arg in render.get_arguments() {
        let (id, heading) = (arg.get_id().as_str(), arg.get_help_heading().unwrap_or_default());
        let about_it = ["Picture", "Camera", "Accuracy"].contains(&heading) && id != "output";
        let wanted = about_it || ["verify", "tile"].contains(&id);
        let (true, Some(long)) = (wanted, arg.get_long()) else { continue };
        if given.value_source(id) != Some(ValueSource::CommandLine) {
            continue;
        }
        for value in given.get_raw(id).into_iter().flatten() {
            flags.push(format!("--{long}={}", value.to_string_lossy()));
        }
    }
    flags
}
