//! Traces tiles for a coordinator.
//!
//! [`run`] keeps a worker at work: it dials a coordinator, registers, renders what
//! it is leased, and dials again when the connection breaks. The same code runs in
//! the `worker` program and inside a coordinator's own process.

mod access;
mod address;
mod backoff;
mod cache;
mod error;
mod heartbeat;
mod memory;
pub mod otlp;
mod prepare;
mod render;
mod renderer;
mod session;
pub mod spans;
mod time;

use std::sync::Arc;
use std::time::{Duration, Instant};

use tessera_proto::identity::Identity;
use tessera_proto::token::Secret;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

pub use access::{Access, AccessError, PkiFiles, given_token};
pub use address::{Address, AddressError};
pub use backoff::Backoff;
pub use error::WorkerError;
pub use memory::{Bytes, default_limit};
pub use render::encode_tile;
pub use renderer::{Exact, RendererFactory, TileTracer};
pub use session::{Credentials, dial};
pub use time::duration;

use cache::SceneCache;
use session::{Outcome, Session};

/// What a worker is told once.
#[derive(Clone, Debug)]
pub struct Config {
    /// Where the coordinator is.
    pub connect: Address,
    /// How to reach it.
    pub access: Access,
    /// Threads that render, at least 1.
    pub threads: usize,
    /// Name shown to people.
    pub name: String,
    /// Whether to leave when the coordinator has no more work, rather than to wait for the next.
    pub once: bool,
    /// The scene of a coordinator in this process.
    pub local: Option<LocalScene>,
    /// Bytes that a scene may take, prepared.
    pub max_memory: u64,
    /// Bytes that prepared scenes may take together, the one at work excepted.
    pub cache: u64,
    /// How long a tile at work may go on when this worker is asked to leave; then its lease is given back.
    pub leave_within: Duration,
    /// What renders tiles.
    pub factory: Arc<dyn RendererFactory>,
    /// How long to wait between attempts to connect.
    pub backoff: Backoff,
    /// How long to try without being welcomed by a coordinator; for ever where there is no end to it.
    pub give_up_after: Option<Duration>,
    /// After how long to leave as if told to.
    pub lifetime: Option<Duration>,
}

impl Config {
    /// A worker like the program's: every core, the exact tracer.
    #[must_use]
    pub fn new(connect: Address) -> Self {
        Self {
            connect,
            access: Access::open(),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            name: "worker".into(),
            once: false,
            local: None,
            max_memory: default_limit(),
            cache: default_limit() / 2,
            leave_within: Duration::from_secs(20),
            factory: Arc::new(Exact),
            backoff: Backoff::default(),
            give_up_after: None,
            lifetime: None,
        }
    }
}

/// A scene that need not be fetched, since its coordinator is in this process.
#[derive(Clone)]
pub struct LocalScene {
    /// Proves to the coordinator that the scene is its own.
    pub secret: Secret,
    /// What renders it, under the coordinator's settings: one for all workers of the process. They connect
    /// before it is there, and then wait for it; if it will never come, they leave.
    pub tracer: watch::Receiver<Option<Arc<dyn TileTracer>>>,
}

impl LocalScene {
    /// Waits for the tracer; `None` if none will come.
    pub(crate) async fn tracer(&self) -> Option<Arc<dyn TileTracer>> {
        self.tracer.clone().wait_for(Option::is_some).await.ok()?.clone()
    }
}

impl std::fmt::Debug for LocalScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LocalScene").finish_non_exhaustive()
    }
}

/// Why a worker left in peace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Left {
    /// The coordinator has no more work, and that was all that was wanted.
    Finished,
    /// Somebody had it leave, where the farm is.
    Dismissed,
    /// It was asked to stop, and returned what it had not begun.
    Stopped,
    /// Its lifetime was over, and it returned what it had not begun.
    Expired,
}

/// Works for the coordinator at `config.connect` until there is no more work (with
/// `config.once`), until `stop` is cancelled, its lifetime is over, or it is refused for good.
///
/// # Errors
/// When the coordinator refuses this worker, there was none for as long as this worker tries, or the machine
/// cannot give what is asked for.
pub async fn run(config: Config, stop: CancellationToken) -> Result<Left, WorkerError> {
    check_arithmetic()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(config.threads.max(1))
        .thread_name(|n| format!("trace-{n}"))
        .build()
        .map_err(|e| WorkerError::Threads(config.threads, e.to_string()))?;
    let session = Session {
        identity: Identity::new()?,
        pool: Arc::new(pool),
        cache: SceneCache::new(config.cache),
        config: config.clone(),
    };
    let Some(lifetime) = config.lifetime else { return work(&session, &stop).await };
    // Ended by either, and only this worker by the end of its life.
    let own = stop.child_token();
    let expired = async {
        tokio::time::sleep(lifetime).await;
        tracing::info!("its lifetime of {lifetime:.1?} is over");
        own.cancel();
        std::future::pending().await
    };
    let left = tokio::select! {
        left = work(&session, &own) => left?,
        () = expired => unreachable!("it waits for the other"),
    };
    Ok(if left == Left::Stopped && !stop.is_cancelled() { Left::Expired } else { left })
}

/// Session after session.
async fn work(session: &Session, stop: &CancellationToken) -> Result<Left, WorkerError> {
    let config = &session.config;
    let mut waits = config.backoff.start();
    let mut alone_since = Instant::now();
    let mut said = None;
    loop {
        let (registered, outcome) = session.run(stop).await;
        if registered {
            waits = config.backoff.start();
            alone_since = Instant::now();
            said = None;
        }
        match outcome {
            Outcome::Stopped => return Ok(Left::Stopped),
            Outcome::Dismissed => return Ok(Left::Dismissed),
            Outcome::Finished if config.once => return Ok(Left::Finished),
            Outcome::Finished => tracing::info!("the coordinator has no more work; waiting for the next"),
            Outcome::Refused(why) => return Err(WorkerError::Refused(why)),
            Outcome::Lost(why) => {
                let left = config.give_up_after.map(|time| time.saturating_sub(alone_since.elapsed()));
                if left == Some(Duration::ZERO) {
                    let address = config.connect.to_string();
                    return Err(WorkerError::GaveUp { address, time: alone_since.elapsed(), last: why });
                }
                // Again and again the same would say nothing new.
                if said.as_ref() == Some(&why) {
                    tracing::debug!("{}: {why}", config.connect);
                } else {
                    // A worker of the coordinator's own process may dial when a short render is over already.
                    match config.local {
                        Some(_) => tracing::info!("{}: {why}; trying again", config.connect),
                        None => tracing::warn!("{}: {why}; trying again", config.connect),
                    }
                    said = Some(why);
                }
            }
        }
        let mut wait = waits.next();
        if let Some(time) = config.give_up_after {
            wait = wait.min(time.saturating_sub(alone_since.elapsed()));
        }
        tracing::debug!("connecting again in {} ms", wait.as_millis());
        tokio::select! {
            () = tokio::time::sleep(wait) => {}
            () = stop.cancelled() => return Ok(Left::Stopped),
        }
    }
}

/// Pixels must not depend on who renders them: denormals have to be on, as IEEE 754 has them.
fn check_arithmetic() -> Result<(), WorkerError> {
    let half = std::hint::black_box(f64::MIN_POSITIVE) / std::hint::black_box(2.0);
    if half > 0.0 { Ok(()) } else { Err(WorkerError::Denormals) }
}
