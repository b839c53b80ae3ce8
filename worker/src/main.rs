//! The `worker` program: renders tiles for a coordinator until told to leave.

mod log;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::{ArgAction, ArgGroup, Parser};
use tokio_util::sync::CancellationToken;
use worker::otlp::{Collector, Otlp};
use worker::{Access, AccessError, Address, Bytes, Config, Left, PkiFiles, WorkerError};

const EXAMPLES: &str = "\
Examples:
  worker farm.example                        render for the coordinator there, port 4747
  worker --connect 10.0.0.5:5000 --threads 4 leave the other cores to others
  worker localhost --once                    leave when the picture is done
  worker farm.example --lifetime 55m --lifetime-stagger 5m
                                             leave in order before a batch system's hour is over
  worker farm.example --token-file token.txt

The coordinator must listen where workers can reach it, for instance:
  coordinator render scene.xml --listen 0.0.0.0:4747
and lets in who has its token, which 'coordinator token' prints there.

Signals: SIGTERM and SIGINT finish the tile at work, return the others and leave;
a second SIGINT leaves at once.

Exit codes: 0 left in peace, 1 refused by the coordinator, unable to work, or no
coordinator for as long as --give-up-after says, 2 wrong usage, 130 interrupted.";

/// Renders tiles for a Tessera coordinator.
///
/// Dials the coordinator, renders what it is given, and dials again, with growing
/// pauses, whenever the connection breaks or no coordinator is there.
#[derive(Debug, Parser)]
#[command(name = "worker", version, long_version = tessera_proto::limits::BUILD, after_help = EXAMPLES, group(ArgGroup::new("where").required(true)))]
struct Args {
    /// The coordinator's address, such as farm.example, 10.0.0.5:5000, [::1]:4747, or 5000 for a port of this machine.
    #[arg(value_name = "HOST[:PORT]", group = "where")]
    coordinator: Option<Address>,

    /// The same.
    #[arg(long, value_name = "HOST[:PORT]", group = "where")]
    connect: Option<Address>,

    /// The farm's token, as the coordinator prints it. Others on this machine may read command lines: --token-file and TESSERA_TOKEN tell them nothing.
    #[arg(long, value_name = "TOKEN")]
    token: Option<String>,

    /// File that holds the token.
    #[arg(long, value_name = "FILE", conflicts_with = "token")]
    token_file: Option<PathBuf>,

    /// Authorities (PEM) that the coordinator's certificate may come from, where there is no token.
    #[arg(long, value_name = "FILE")]
    tls_ca: Option<PathBuf>,

    /// This worker's certificate (PEM), for coordinators that ask for one.
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,

    /// The certificate's key (PEM).
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,

    /// Memory that a scene may take here. [default: three quarters of what there is]
    #[arg(long, value_name = "SIZE")]
    max_memory: Option<Bytes>,

    /// Memory for prepared scenes that are kept for later jobs. [default: half of --max-memory]
    #[arg(long, value_name = "SIZE")]
    cache: Option<Bytes>,

    /// Threads that render. [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    threads: Option<u32>,

    /// Name that the coordinator shows. [default: this machine's name]
    #[arg(long)]
    name: Option<String>,

    /// Leave when the coordinator has no more work.
    #[arg(long)]
    once: bool,

    /// Leave when there has been no coordinator for so long: 90s, 10m, 2h. [default: never]
    #[arg(long, value_name = "D", value_parser = worker::duration)]
    give_up_after: Option<Duration>,

    /// Leave after so long, in order: the tile at work is finished, the others are returned. [default: never]
    #[arg(long, value_name = "D", value_parser = worker::duration)]
    lifetime: Option<Duration>,

    /// Leave up to so much earlier than --lifetime says, by chance, so that not all workers leave at once.
    #[arg(long, value_name = "D", value_parser = worker::duration, requires = "lifetime")]
    lifetime_stagger: Option<Duration>,

    /// Send spans of what is rendered to an OpenTelemetry collector, as OTLP over gRPC: http://HOST[:PORT], port 4317 where none is given.
    #[arg(long, value_name = "URL")]
    otlp: Option<Collector>,

    /// Say more: -v steps, -vv details, -vvv everything. RUST_LOG overrides it.
    #[arg(short, long, action = ArgAction::Count)]
    verbose: u8,
}

fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        // Help that cannot be written is no success.
        Err(e) => {
            let written = e.print();
            return ExitCode::from(match written {
                _ if e.use_stderr() => 2,
                Ok(()) => 0,
                Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => 0,
                Err(_) => 1,
            });
        }
    };
    // Ends last, so that all spans are sent.
    let otlp = match args.otlp.as_ref().map(|to| Otlp::start(to, "worker")).transpose() {
        Ok(otlp) => otlp,
        Err(e) => {
            log::say(&format!("worker: cannot start: {e}"));
            return ExitCode::FAILURE;
        }
    };
    log::start(args.verbose, otlp.as_ref());
    match run(args) {
        Ok(code) => code,
        Err(e) => {
            log::say(&format!("worker: {e}"));
            ExitCode::from(if matches!(e, MainError::Access(_)) { 2 } else { 1 })
        }
    }
}

/// Why the program could not even start.
#[derive(Debug, thiserror::Error)]
enum MainError {
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Worker(#[from] WorkerError),
    #[error("cannot start: {0}")]
    System(#[from] std::io::Error),
}

fn run(args: Args) -> Result<ExitCode, MainError> {
    // Clap sees to it that there is one.
    let Some(connect) = args.connect.or(args.coordinator) else { return Ok(ExitCode::from(2)) };
    let mut config = Config::new(connect);
    let variable = std::env::var("TESSERA_TOKEN").ok();
    let token = worker::given_token(args.token.as_deref(), args.token_file.as_deref(), variable.as_deref())?;
    let files = PkiFiles { ca: args.tls_ca, cert: args.tls_cert, key: args.tls_key };
    config.access = Access::new(token.as_ref(), &files)?;
    if let Some(Bytes(bytes)) = args.max_memory {
        config.max_memory = bytes;
    }
    config.cache = args.cache.map_or(config.max_memory / 2, |Bytes(bytes)| bytes);
    if let Some(threads) = args.threads {
        config.threads = threads as usize;
    }
    config.name = args.name.unwrap_or_else(|| gethostname::gethostname().to_string_lossy().into_owned());
    config.once = args.once;
    config.give_up_after = args.give_up_after;
    let earlier = args.lifetime_stagger.unwrap_or_default().mul_f64(fastrand::f64());
    config.lifetime = args.lifetime.map(|lifetime| lifetime.saturating_sub(earlier));
    // The network needs little: the other threads are for rendering.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let stop = CancellationToken::new();
    let code = runtime.block_on(async {
        let interrupted = on_signals(&stop)?;
        let left = worker::run(config, stop).await?;
        tracing::info!("{}", reason(left));
        Ok(if interrupted.is_cancelled() { ExitCode::from(130) } else { ExitCode::SUCCESS })
    });
    // A tile or a scene at work is of no use to anyone now.
    runtime.shutdown_background();
    code
}

/// Why it leaves.
fn reason(left: Left) -> &'static str {
    match left {
        Left::Finished => "left: no more work",
        Left::Dismissed => "left: somebody had it leave, where the farm is",
        Left::Stopped => "left: told to stop",
        Left::Expired => "left: its lifetime is over",
    }
}

/// Cancels `stop` at the first signal; leaves at once at the second SIGINT. What it gives says
/// whether there was a SIGINT.
#[cfg(unix)]
fn on_signals(stop: &CancellationToken) -> std::io::Result<CancellationToken> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut term, mut int) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    let (stop, interrupted) = (stop.clone(), CancellationToken::new());
    let tell = interrupted.clone();
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = term.recv() => stop.cancel(),
                _ = int.recv() => {
                    if tell.is_cancelled() {
                        std::process::exit(130);
                    }
                    tell.cancel();
                    stop.cancel();
                }
            }
        }
    });
    Ok(interrupted)
}

/// Cancels `stop` at the first Ctrl-C; leaves at once at the second.
#[cfg(not(unix))]
fn on_signals(stop: &CancellationToken) -> std::io::Result<CancellationToken> {
    let (stop, interrupted) = (stop.clone(), CancellationToken::new());
    let tell = interrupted.clone();
    tokio::spawn(async move {
        while tokio::signal::ctrl_c().await.is_ok() {
            if tell.is_cancelled() {
                std::process::exit(130);
            }
            tell.cancel();
            stop.cancel();
        }
    });
    Ok(interrupted)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_holds_together() {
        Args::command().debug_assert();
    }

    #[test]
    fn a_coordinator_is_named_once_either_way() {
        let parsed = |args: &[&str]| Args::try_parse_from([&["worker"], args].concat());
        assert_eq!(parsed(&["localhost"]).unwrap().coordinator.unwrap().to_string(), "localhost:4747");
        assert_eq!(parsed(&["--connect", "5015"]).unwrap().connect.unwrap().to_string(), "localhost:5015");
        assert!(parsed(&[]).is_err() && parsed(&["a", "--connect", "b"]).is_err());
        assert!(parsed(&["a", "--lifetime-stagger", "5m"]).is_err());
    }
}
