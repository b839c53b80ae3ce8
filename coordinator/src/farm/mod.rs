//! A farm: it listens for workers, and has them render its jobs. [`Farm::render`] is a farm of one job;
//! [`Farm::serve`](crate::Farm::serve) one whose jobs come and go.

mod dispatch;
mod gate;
mod guard;
mod incoming;
mod liveness;
mod pace;
mod passes;
mod roster;
mod run;
mod service;
mod shares;
mod stitch;
mod strangers;
mod users;
pub(crate) mod verify;

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;

use tessera_core::trace::PreparedScene;
use tessera_proto::limits::{KEEPALIVE_INTERVAL, KEEPALIVE_TIMEOUT};
use tessera_proto::token::{NoRandomness, Token};
use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio::task::{AbortHandle, JoinSet};
use tokio_util::sync::{CancellationToken, DropGuard};
use tonic::service::Routes;
use tonic::transport::Server;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;
use tracing::info_span;
use worker::spans::{SPANS, context_of};
use worker::{LocalScene, TileTracer};

use crate::access::{Access, Guarded};
use crate::config::{ListenAddr, Timing};
use crate::error::RenderError;
use crate::job::{RenderJob, Rendered, SceneSource, Unfinished};
use crate::progress::Progress;
use dispatch::Dispatcher;
use gate::Gate;
use guard::GuardLayer;
use incoming::Admission;
use service::{FarmEvent, Service, Shared};

pub(crate) use dispatch::{FARM, Order, Standing, WorkerView};
pub(crate) use gate::prefix;
pub use strangers::Strangers;
pub(crate) use users::UserGate;

/// What workers said and the driver has not heard yet: bounds memory, since every tile may be
/// 768 KiB.
const HEARD: usize = 16;
/// Streams of one connection: the session, a heartbeat, a fetch, and some to spare.
const STREAMS: u32 = 8;
/// Bytes of results that one connection may have on their way.
const WINDOW: u32 = 4 << 20;
/// Bytes of results at a time: many to a tile, so that a heartbeat does not wait long behind them.
const FRAME: u32 = 128 << 10;

/// A farm that listens, so that a busy port is known before anything is read or traced.
pub struct Farm {
    addr: SocketAddr,
    shared: Arc<Shared>,
    heard: mpsc::Receiver<FarmEvent>,
    server: Aborted,
    hired: Option<Hired>,
    guard: Option<Arc<Guarded>>,
    strangers: Arc<Strangers>,
    /// Tells whoever asks by gRPC's health checks.
    health: HealthReporter,
    /// Whatever ends the farm ends the server and the workers with it.
    closing: DropGuard,
}

impl std::fmt::Debug for Farm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Farm").field("addr", &self.addr).finish_non_exhaustive()
    }
}

/// Workers in this process.
struct Hired {
    count: usize,
    /// Where they are given what they render with.
    tracer: watch::Sender<Option<Arc<dyn TileTracer>>>,
    /// They end when the set is dropped.
    _tasks: JoinSet<()>,
}

impl Farm {
    /// Listens for workers, and asks them for nothing: for loopback.
    /// Must be called inside a runtime.
    ///
    /// # Errors
    /// [`RenderError::Listen`] when the address is taken or not of this machine.
    pub async fn bind(listen: ListenAddr) -> Result<Self, RenderError> {
        Self::bind_guarded(listen, &Access::open()).await
    }

    /// Listens for workers that `access` lets in. They can connect from now on; they are answered once
    /// [`Farm::render`] runs. Must be called inside a runtime.
    ///
    /// # Errors
    /// [`RenderError::Listen`] when the address is taken or not of this machine.
    pub async fn bind_guarded(listen: ListenAddr, access: &Access) -> Result<Self, RenderError> {
        Self::bind_for(listen, access, |_, services| services).await
    }

    /// As [`Farm::bind_guarded`]; `users` adds the services of those who are no workers.
    pub(crate) async fn bind_for(
        listen: ListenAddr,
        access: &Access,
        users: impl FnOnce(UserGate, Routes) -> Routes,
    ) -> Result<Self, RenderError> {
        let wanted = match listen {
            ListenAddr::Loopback => SocketAddr::from(([127, 0, 0, 1], 0)),
            ListenAddr::Socket(addr) => addr,
        };
        let failed = |source| RenderError::Listen { addr: wanted, source };
        let listener = TcpListener::bind(wanted).await.map_err(failed)?;
        let addr = listener.local_addr().map_err(failed)?;
        let (heard_by, heard) = mpsc::channel(HEARD);
        let randomness = |e: NoRandomness| RenderError::Internal(e.to_string());
        let (gate, strangers) = (Gate::new(), Arc::new(Strangers::default()));
        let shared = Arc::new(Shared::new(heard_by, gate.clone()).map_err(randomness)?);
        let guard = access.guard().cloned();
        let layer = GuardLayer { strangers: strangers.clone(), guard: guard.clone(), local: shared.secret };
        let (health, checked) = tonic_health::server::health_reporter();
        health.set_service_status("", ServingStatus::NotServing).await;
        let services = Routes::new(Service(shared.clone()).into_server()).add_service(checked);
        let services = users(UserGate::new(gate.clone()), services);
        let admission = Admission { gate, strangers: strangers.clone(), guard: guard.clone() };
        let closing = CancellationToken::new();
        let server = Server::builder()
            .max_concurrent_streams(STREAMS)
            .initial_stream_window_size(WINDOW)
            .initial_connection_window_size(WINDOW)
            .max_frame_size(FRAME)
            .http2_keepalive_interval(Some(KEEPALIVE_INTERVAL))
            .http2_keepalive_timeout(Some(KEEPALIVE_TIMEOUT))
            .layer(layer)
            .add_routes(services)
            .serve_with_incoming_shutdown(
                incoming::accept(listener, admission, closing.clone()),
                closing.clone().cancelled_owned(),
            );
        let server = Aborted(tokio::spawn(server).abort_handle());
        Ok(Self { addr, shared, heard, server, hired: None, guard, strangers, health, closing: closing.drop_guard() })
    }

    /// Starts `workers` in this process, of so many `threads` together and one each at least. They connect now
    /// and then wait for a scene: what a job says of workers and threads does not count then. If none were hired,
    /// [`Farm::render`] hires those of its job. Must be called inside a runtime.
    pub fn hire(&mut self, workers: usize, threads: usize) {
        if workers == 0 || self.hired.is_some() {
            return;
        }
        let (tracer, local) = watch::channel(None);
        let local = LocalScene { secret: self.shared.secret, tracer: local };
        let stop = self.closing.token();
        let access = match &self.guard {
            None => worker::Access::open(),
            Some(guard) => {
                let token = Token { pin: guard.pin, secret: self.shared.secret };
                worker::Access::by_token(&token).unwrap_or_default()
            }
        };
        let _tasks = start_workers((workers, threads), (self.addr, access), &local, stop);
        self.hired = Some(Hired { count: workers, tracer, _tasks });
    }

    /// Who came with a wrong secret: those of the page count among them.
    #[must_use]
    pub fn strangers(&self) -> Arc<Strangers> {
        self.strangers.clone()
    }

    /// The address workers connect to, with its actual port.
    #[must_use]
    pub fn addr(&self) -> SocketAddr {
        self.addr
    }

    /// Renders `job`, keeping `progress` up to date, until done, failed or cancelled.
    ///
    /// # Errors
    /// [`Unfinished`], with everything that was done until then.
    pub async fn render(
        mut self,
        job: RenderJob,
        progress: watch::Sender<Progress>,
        cancel: CancellationToken,
    ) -> Result<Rendered, Unfinished> {
        self.hire(job.workers, job.threads);
        let tracer = if self.hired.is_some() { Some(tracer(&job).await?) } else { None };
        let Self { shared, heard, server, hired, strangers, health, closing, .. } = self;
        if let Some(trace) = context_of(&job.span) {
            let _ = shared.trace.set(trace);
        }
        health.set_service_status("", ServingStatus::Serving).await;
        if let Some(hired) = &hired {
            hired.tracer.send_replace(tracer);
        }
        let count = hired.as_ref().map_or(0, |hired| hired.count);
        let dispatcher = Dispatcher::new(shared, heard, job.timing, count);
        let finished = beside(dispatcher.render_one(job, progress, cancel)).await??;
        let rendered = finished.rendered(strangers.total()).await;
        drop((server, hired, closing));
        rendered
    }

    /// Renders what it is ordered until `cancel`; then every job ends as it is, and the workers are dismissed.
    /// `serving` is given the workers as they come and go. Once it is `closing`, it says so to whoever asks.
    pub(crate) async fn obey(
        self,
        orders: mpsc::Receiver<Order>,
        serving: impl FnOnce(watch::Receiver<Vec<WorkerView>>),
        (closing, cancel): (impl Future<Output = ()>, CancellationToken),
    ) {
        let Self { shared, heard, server, health, closing: ending, .. } = self;
        let span = info_span!(target: SPANS, parent: None, "serve");
        if let Some(trace) = context_of(&span) {
            let _ = shared.trace.set(trace);
        }
        health.set_service_status("", ServingStatus::Serving).await;
        let dispatcher = Dispatcher::new(shared, heard, Timing::default(), 0);
        serving(dispatcher.views());
        let closing_soon = async {
            closing.await;
            health.set_service_status("", ServingStatus::NotServing).await;
            std::future::pending().await
        };
        tokio::select! {
            served = beside(dispatcher.serve(orders, cancel)) => if let Err(e) = served {
                tracing::error!("{e}");
            },
            () = closing_soon => {}
        }
        drop((server, ending));
    }
}

/// Runs `task` on the runtime's own threads, where its connections run, too: whoever only waits here would have to be
/// woken for every message. It ends with whoever waits.
async fn beside<T: Send + 'static>(task: impl Future<Output = T> + Send + 'static) -> Result<T, RenderError> {
    let task = tokio::spawn(task);
    let _ended = Aborted(task.abort_handle());
    task.await.map_err(|e| RenderError::Internal(e.to_string()))
}

/// What renders tiles in this process, one for all its workers.
async fn tracer(job: &RenderJob) -> Result<Arc<dyn TileTracer>, RenderError> {
    let (scene, factory, settings) = (job.scene.clone(), job.factory.clone(), job.settings);
    let opened = tokio::task::spawn_blocking(move || {
        let prepared = match scene {
            SceneSource::Prepared(prepared) => prepared,
            SceneSource::Resolved(scene) => Arc::new(PreparedScene::build(scene)),
        };
        factory.open(prepared, settings)
    });
    Ok(opened.await.map_err(|e| RenderError::Internal(e.to_string()))??)
}

/// Starts workers that share so many threads; they end when the set is dropped.
fn start_workers(
    (workers, threads): (usize, usize),
    (addr, access): (SocketAddr, worker::Access),
    local: &LocalScene,
    stop: &CancellationToken,
) -> JoinSet<()> {
    let mut tasks = JoinSet::new();
    let reach = match addr.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => SocketAddr::from((Ipv4Addr::LOCALHOST, addr.port())),
        IpAddr::V6(ip) if ip.is_unspecified() => SocketAddr::from((Ipv6Addr::LOCALHOST, addr.port())),
        _ => addr,
    };
    for n in 0..workers {
        let share = threads / workers + usize::from(n < threads % workers);
        let config = worker::Config {
            threads: share.max(1),
            name: format!("local-{}", n + 1),
            once: true,
            local: Some(local.clone()),
            access: access.clone(),
            ..worker::Config::new(reach.into())
        };
        let stop = stop.clone();
        tasks.spawn(async move {
            let name = config.name.clone();
            if let Err(e) = worker::run(config, stop).await {
                tracing::error!("{name}: {e}");
            }
        });
    }
    tasks
}

/// Ends a task with its owner.
struct Aborted(AbortHandle);

impl Drop for Aborted {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// [`Farm::bind`] and [`Farm::render`] in one.
///
/// # Errors
/// Those of both.
pub async fn render(
    job: RenderJob,
    listen: ListenAddr,
    progress: watch::Sender<Progress>,
    cancel: CancellationToken,
) -> Result<Rendered, Unfinished> {
    Farm::bind(listen).await?.render(job, progress, cancel).await
}
