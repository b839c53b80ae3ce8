//! The `worker` program: renders tiles for a coordinator until told to leave.

use std::process::ExitCode;

use clap::{ArgAction, Parser};
use tokio_util::sync::CancellationToken;
use tracing_subscriber::EnvFilter;
use worker::{Address, Config, Left, WorkerError};

const EXAMPLES: &str = "\
Examples:
  worker --connect farm.example              render for the coordinator there, port 4747
  worker --connect 10.0.0.5:5000 --threads 4 leave the other cores to others
  worker --connect localhost --once          leave when the picture is done

The coordinator must listen where workers can reach it, for instance:
  coordinator render scene.xml --listen 0.0.0.0:4747

Signals: SIGTERM and SIGINT finish the tile at work, return the others and leave;
a second SIGINT leaves at once.

Exit codes: 0 left in peace, 1 refused by the coordinator or unable to work,
2 wrong usage, 130 interrupted.";

/// Renders tiles for a Tessera coordinator.
///
/// Dials the coordinator, renders what it is given, and dials again, with growing
/// pauses, whenever the connection breaks or no coordinator is there.
#[derive(Debug, Parser)]
#[command(name = "worker", version, after_help = EXAMPLES)]
struct Args {
    /// The coordinator's address, such as farm.example, 10.0.0.5:5000 or [::1]:4747.
    #[arg(long, value_name = "HOST[:PORT]")]
    connect: Address,

    /// Threads that render. [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    threads: Option<u32>,

    /// Name that the coordinator shows. [default: this machine's name]
    #[arg(long)]
    name: Option<String>,

    /// Leave when the coordinator has no more work.
    #[arg(long)]
    once: bool,

    /// Say more; twice, still more. RUST_LOG overrides it.
    #[arg(short, long, action = ArgAction::Count)]
    verbose: u8,
}

fn main() -> ExitCode {
    let args = Args::parse();
    log(args.verbose);
    match run(args) {
        Ok(code) => code,
        Err(e) => {
            eprintln!("worker: {e}");
            ExitCode::from(1)
        }
    }
}

fn log(verbose: u8) {
    let level = match verbose {
        0 => "worker=info,warn",
        1 => "worker=debug,info",
        _ => "worker=trace,debug",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_target(false).init();
}

/// Why the program could not even start.
#[derive(Debug, thiserror::Error)]
enum MainError {
    #[error(transparent)]
    Worker(#[from] WorkerError),
    #[error("cannot start: {0}")]
    System(#[from] std::io::Error),
}

fn run(args: Args) -> Result<ExitCode, MainError> {
    let mut config = Config::new(args.connect);
    if let Some(threads) = args.threads {
        config.threads = threads as usize;
    }
    config.name = args.name.unwrap_or_else(|| gethostname::gethostname().to_string_lossy().into_owned());
    config.once = args.once;
    // The network needs little: the other threads are for rendering.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let stop = CancellationToken::new();
    let code = runtime.block_on(async {
        let interrupted = on_signals(&stop)?;
        let left = worker::run(config, stop).await?;
        tracing::info!("{}", if left == Left::Finished { "no more work: leaving" } else { "leaving" });
        Ok(if interrupted.is_cancelled() { ExitCode::from(130) } else { ExitCode::SUCCESS })
    });
    // A tile or a scene at work is of no use to anyone now.
    runtime.shutdown_background();
    code
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
