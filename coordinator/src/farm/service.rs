//! The gRPC service: a thin layer between workers and the dispatcher.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock};

use tessera_core::scene::Scene;
use tessera_core::settings::Settings;
use tessera_proto::convert::{Malformed, Registration, TileDone, cause, check_match, check_pixels};
use tessera_proto::identity::Challenge;
use tessera_proto::limits::{MAX_MESSAGE_BYTES, REGISTER_WITHIN, SCENE_PIECE_BYTES};
use tessera_proto::plausible::{brightest, check_light, check_rays};
use tessera_proto::scene::{SceneEncoder, describe};
use tessera_proto::token::{NoRandomness, Secret, random};
use tessera_proto::wire::farm_server::{self, FarmServer};
use tessera_proto::wire::worker_message::Kind;
use tessera_proto::wire::{self, BeatReply, BeatRequest, CoordinatorMessage, ScenePiece, SceneRequest, WorkerMessage};
use tessera_proto::{Attempt, JobNumber, LeaseId, PixelFormat, SceneHash, SessionId, TraceContext};
use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::{Request, Response, Status, Streaming};
use tracing::{Span, info_span};
use worker::spans::{SPANS, under};

use super::gate::Gate;
use super::guard::for_good;
use super::incoming::Peer;
use super::liveness::LastSign;
use super::verify::Sum;
use crate::scheduler::WorkerKey;

/// Messages to one worker that wait to be sent; a worker that lets more pile up does not read.
pub(super) const MOUTH: usize = 128;

/// How a worker leaves that ends its half of the stream.
pub(super) const IN_PEACE: &str = "it ended the session";

/// How causes begin that are the network's.
pub(super) const BROKE: &str = "the connection broke";

/// Where the dispatcher speaks to a worker.
pub(super) type Outbox = mpsc::Sender<Result<CoordinatorMessage, Status>>;

/// What the dispatcher hears.
#[derive(Debug)]
pub(super) enum FarmEvent {
    /// A worker that fits registered.
    Joined(Joined),
    /// A worker said something.
    Said { worker: WorkerKey, said: WorkerEvent },
    /// This process rendered a check's tile, or could not.
    Decided { check: u64, sum: Option<Sum> },
    /// The scene of a job can be named now.
    Described(JobNumber),
    /// A worker's stream ended.
    Left { worker: WorkerKey, cause: String },
}

/// A registration, and the way to answer it.
#[derive(Debug)]
pub(super) struct Joined {
    pub(super) registration: Registration,
    /// Whether it is of this process.
    pub(super) local: bool,
    pub(super) address: String,
    /// When something was last heard of it.
    pub(super) last_sign: LastSign,
    pub(super) outbox: Outbox,
    /// Ends the session's reader.
    pub(super) cut: CancellationToken,
    pub(super) reply: oneshot::Sender<Result<(WorkerKey, SessionId), Status>>,
}

/// What a worker says once registered, in core's words.
#[derive(Debug)]
pub(super) enum WorkerEvent {
    Ready(JobNumber),
    Done(TileDone),
    Failed {
        lease: LeaseId,
        attempt: Attempt,
        cause: String,
    },
    Returned {
        lease: LeaseId,
        attempt: Attempt,
    },
    Draining,
    Unable(JobNumber, String),
    /// A tile of a job that is not rendered now.
    Stale(LeaseId),
    /// Something that the protocol does not allow.
    Nonsense(String),
}

/// What workers are told of a job.
#[derive(Debug)]
pub(super) struct Offer {
    scene: Arc<Scene>,
    pub(super) settings: Settings,
    pub(super) pixels: PixelFormat,
    /// Hash and length of the scene's binary form, once a worker needed them.
    name: OnceLock<(SceneHash, u64)>,
    /// Whether they are being taken.
    naming: AtomicBool,
}

impl Offer {
    pub(super) fn new(scene: Arc<Scene>, settings: Settings, pixels: PixelFormat) -> Self {
        Self { scene, settings, pixels, name: OnceLock::new(), naming: AtomicBool::new(false) }
    }

    /// With hash and length of the scene's binary form, which are known.
    pub(super) fn described(self, name: (SceneHash, u64)) -> Self {
        Self { name: name.into(), ..self }
    }

    /// Hash and length of the scene's binary form, where they are known.
    pub(super) fn scene_name(&self) -> Option<(SceneHash, u64)> {
        self.name.get().copied()
    }

    /// Whether a delivery can be part of this picture, whatever its lease.
    fn check(&self, done: &TileDone) -> Result<(), Malformed> {
        let (lights, max_depth) = (self.scene.lights().len(), self.settings.max_depth);
        check_pixels(&done.pixels, self.pixels)?;
        if self.pixels == PixelFormat::F32 {
            check_light(&done.pixels, brightest(lights, max_depth))?;
        }
        let pixels = done.pixels.len() / self.pixels.bytes_per_pixel();
        check_rays(&done.rays, pixels as u64, lights, max_depth)
    }
}

/// What the service knows.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) heard: mpsc::Sender<FarmEvent>,
    pub(super) sessions: Mutex<HashMap<SessionId, Visitor>>,
    offers: RwLock<Offers>,
    /// Known to workers of this process alone.
    pub(super) secret: Secret,
    pub(super) gate: Arc<Gate>,
    /// What workers hang the spans of their sessions under.
    pub(super) trace: OnceLock<TraceContext>,
}

/// Jobs that are rendered.
#[derive(Debug, Default)]
struct Offers {
    jobs: BTreeMap<JobNumber, Arc<Offer>>,
    /// Numbers below were given to jobs.
    given: u64,
}

/// A session, as the other calls see it.
#[derive(Clone, Debug)]
pub(super) struct Visitor {
    fetching: Arc<AtomicBool>,
    last_sign: LastSign,
}

impl Visitor {
    pub(super) fn new(last_sign: LastSign) -> Self {
        Self { fetching: Arc::default(), last_sign }
    }
}

/// Allows the next fetch when this one is over.
struct Fetching(Arc<AtomicBool>);

impl Drop for Fetching {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Release);
    }
}

fn over() -> Status {
    Status::unavailable("the coordinator is closing")
}

impl Shared {
    /// Behind this, and `heard` by whoever listens.
    pub(super) fn new(heard: mpsc::Sender<FarmEvent>, gate: Arc<Gate>) -> Result<Self, NoRandomness> {
        Ok(Self {
            heard,
            sessions: Mutex::default(),
            offers: RwLock::default(),
            secret: Secret::new()?,
            gate,
            trace: OnceLock::new(),
        })
    }

    /// Offers a job.
    pub(super) fn offer(&self, number: JobNumber, offer: Offer) {
        let mut offers = self.offers.write().unwrap_or_else(PoisonError::into_inner);
        offers.given = offers.given.max(number.0 + 1);
        offers.jobs.insert(number, Arc::new(offer));
    }

    /// Offers a job no more; gives its scene's hash, where it has one.
    pub(super) fn withdraw(&self, number: JobNumber) -> Option<SceneHash> {
        let mut offers = self.offers.write().unwrap_or_else(PoisonError::into_inner);
        offers.jobs.remove(&number)?.scene_name().map(|(hash, _)| hash)
    }

    /// A job that is offered.
    pub(super) fn offered(&self, number: JobNumber) -> Option<Arc<Offer>> {
        self.offers.read().unwrap_or_else(PoisonError::into_inner).jobs.get(&number).cloned()
    }

    /// Whether there is or was a job of this number.
    pub(super) fn was_given(&self, number: JobNumber) -> bool {
        number.0 < self.offers.read().unwrap_or_else(PoisonError::into_inner).given
    }

    /// An offer with this scene.
    fn with_scene(&self, hash: &[u8]) -> Option<Arc<Offer>> {
        let offers = self.offers.read().unwrap_or_else(PoisonError::into_inner);
        offers.jobs.values().find(|o| o.scene_name().is_some_and(|(h, _)| h.0 == hash)).cloned()
    }

    /// Whether a job that is offered shows this scene.
    pub(super) fn keeps(&self, hash: SceneHash) -> bool {
        self.with_scene(&hash.0).is_some()
    }

    /// Takes hash and length of a job's scene, on a thread of its own; [`FarmEvent::Described`] tells when they are there.
    pub(super) fn describe(&self, number: JobNumber) {
        let Some(offer) = self.offered(number) else { return };
        if offer.naming.swap(true, Ordering::AcqRel) {
            return;
        }
        let heard = self.heard.clone();
        tokio::task::spawn_blocking(move || {
            let _ = offer.name.set(describe(&offer.scene));
            let _ = heard.blocking_send(FarmEvent::Described(number));
        });
    }

    fn visitor(&self, session: u64) -> Result<Visitor, Status> {
        let sessions = self.sessions.lock().unwrap_or_else(PoisonError::into_inner);
        sessions.get(&SessionId(session)).cloned().ok_or_else(|| Status::not_found("this session is over"))
    }

    /// Reads one worker until its stream ends, and gives why; a broken stream is told so too.
    async fn listen(&self, worker: WorkerKey, outbox: &Outbox, inbox: &mut Streaming<WorkerMessage>) -> String {
        let told = |status: Status| {
            let cause = says(&status);
            let _ = outbox.try_send(Err(status));
            cause
        };
        loop {
            let said = match inbox.message().await {
                Ok(Some(message)) => self.understand(message),
                Ok(None) => return IN_PEACE.into(),
                Err(status) => return format!("{BROKE}: {}", told(status)),
            };
            if self.heard.send(FarmEvent::Said { worker, said }).await.is_err() {
                return "the render is over".into();
            }
        }
    }

    fn understand(&self, message: WorkerMessage) -> WorkerEvent {
        match message.kind {
            Some(Kind::TileDone(done)) => {
                let lease = LeaseId(done.lease);
                let Some(offer) = self.offered(lease.job()) else { return WorkerEvent::Stale(lease) };
                let done = TileDone::try_from(done).and_then(|d| offer.check(&d).map(|()| d));
                done.map_or_else(|e| WorkerEvent::Nonsense(format!("a tile: {e}")), WorkerEvent::Done)
            }
            Some(Kind::TileFailed(f)) => {
                WorkerEvent::Failed { lease: LeaseId(f.lease), attempt: Attempt(f.attempt), cause: cause(&f.cause) }
            }
            Some(Kind::LeaseReturned(r)) => {
                WorkerEvent::Returned { lease: LeaseId(r.lease), attempt: Attempt(r.attempt) }
            }
            Some(Kind::Ready(r)) => WorkerEvent::Ready(JobNumber(r.job)),
            Some(Kind::Draining(_)) => WorkerEvent::Draining,
            Some(Kind::Unable(u)) => WorkerEvent::Unable(JobNumber(u.job), cause(&u.cause)),
            Some(Kind::Register(_)) => WorkerEvent::Nonsense("it registered twice".into()),
            None => WorkerEvent::Nonsense("an unknown message".into()),
        }
    }
}

/// Who calls.
fn peer<T>(request: &Request<T>) -> Result<Peer, Status> {
    let peer = request.extensions().get::<Peer>().cloned();
    peer.ok_or_else(|| Status::internal("a call without a connection"))
}

/// What a broken stream says.
fn says(status: &Status) -> String {
    let mut text = cause(status.message());
    let mut source = std::error::Error::source(status);
    while let Some(s) = source {
        let more = s.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        source = s.source();
    }
    text
}

/// See the [module](self).
#[derive(Clone, Debug)]
pub(super) struct Service(pub(super) Arc<Shared>);

impl Service {
    pub(super) fn into_server(self) -> FarmServer<Self> {
        FarmServer::new(self).max_decoding_message_size(MAX_MESSAGE_BYTES).max_encoding_message_size(MAX_MESSAGE_BYTES)
    }
}

#[tonic::async_trait]
impl farm_server::Farm for Service {
    type WorkStream = ReceiverStream<Result<CoordinatorMessage, Status>>;
    type FetchSceneStream = ReceiverStream<Result<ScenePiece, Status>>;

    async fn greet(&self, request: Request<wire::GreetRequest>) -> Result<Response<wire::Challenge>, Status> {
        let challenge: Challenge = random().map_err(|e: NoRandomness| Status::internal(e.to_string()))?;
        peer(&request)?.connection.ask(challenge);
        Ok(Response::new(wire::Challenge { challenge: challenge.to_vec() }))
    }

    async fn work(&self, request: Request<Streaming<WorkerMessage>>) -> Result<Response<Self::WorkStream>, Status> {
        let peer = peer(&request)?;
        let address = peer.address.to_string();
        let one = || Status::resource_exhausted("one session a connection at a time");
        let in_session = peer.connection.begin().ok_or_else(one)?;
        let mut inbox = request.into_inner();
        let first = timeout(REGISTER_WITHIN, inbox.message())
            .await
            .map_err(|_| Status::deadline_exceeded("a worker registers first"))??;
        let Some(WorkerMessage { kind: Some(Kind::Register(register)) }) = first else {
            return Err(Status::invalid_argument("a worker registers first"));
        };
        check_match(&register).map_err(|e| {
            tracing::warn!("refused a worker from {address}: {e}");
            for_good(Status::failed_precondition(e.to_string()))
        })?;
        let registration = Registration::try_from(register).map_err(|e| Status::invalid_argument(e.to_string()))?;
        let challenge = peer.connection.asked();
        if !challenge.is_some_and(|c| registration.id.has_proven(&c, &registration.proof)) {
            return Err(Status::invalid_argument("a worker proves that its key is its own"));
        }
        let local = registration.local == Some(self.0.secret);
        if registration.local.is_some() && !local {
            return Err(Status::invalid_argument("the local secret is wrong"));
        }
        let (outbox, words) = mpsc::channel(MOUTH);
        let (reply, answer) = oneshot::channel();
        let cut = CancellationToken::new();
        let joined = Joined {
            registration,
            local,
            address,
            last_sign: peer.last_sign,
            outbox: outbox.clone(),
            cut: cut.clone(),
            reply,
        };
        self.0.gate.settle(&peer.connection);
        self.0.heard.send(FarmEvent::Joined(joined)).await.map_err(|_| over())?;
        let (worker, session) = tokio::select! {
            biased;
            answer = answer => answer.map_err(|_| over())??,
            // Nothing is kept for whoever goes on before it is welcomed.
            more = inbox.message() => return Err(match more {
                Ok(Some(_)) => Status::invalid_argument("a worker waits to be welcomed"),
                Ok(None) => Status::cancelled("the worker left"),
                Err(status) => status,
            }),
        };
        let shared = self.0.clone();
        tokio::spawn(async move {
            let _in_session = in_session;
            let cause = tokio::select! {
                cause = shared.listen(worker, &outbox, &mut inbox) => cause,
                () = cut.cancelled() => "it was cut off".into(),
            };
            shared.sessions.lock().unwrap_or_else(PoisonError::into_inner).remove(&session);
            let _ = shared.heard.send(FarmEvent::Left { worker, cause }).await;
        });
        let mut answer = Response::new(ReceiverStream::new(words));
        if let Some(trace) = self.0.trace.get() {
            trace.put(answer.metadata_mut());
        }
        Ok(answer)
    }

    async fn beat(&self, request: Request<BeatRequest>) -> Result<Response<BeatReply>, Status> {
        let visitor = self.0.visitor(request.get_ref().session)?;
        let connection = peer(&request)?.connection;
        connection.beaten();
        self.0.gate.settle(&connection);
        // The dispatcher looks at it now and then: beats wait in no queue, and a flood of them fills none.
        visitor.last_sign.beat();
        Ok(Response::new(BeatReply {}))
    }

    async fn fetch_scene(&self, request: Request<SceneRequest>) -> Result<Response<Self::FetchSceneStream>, Status> {
        let trace = TraceContext::of(request.metadata());
        let request = request.into_inner();
        let visitor = self.0.visitor(request.session)?;
        let offer = self.0.with_scene(&request.scene_sha256);
        let offer = offer.ok_or_else(|| Status::not_found("this is not the scene of a job that is rendered"))?;
        if visitor.fetching.swap(true, Ordering::AcqRel) {
            return Err(Status::resource_exhausted("one fetch a session at a time"));
        }
        let fetching = Fetching(visitor.fetching);
        // Pieces are made as fast as they are sent, and never all at once.
        let (sender, pieces) = mpsc::channel(2);
        let scene = offer.scene.clone();
        // Of whoever records none there is nothing to be part of.
        let sending = || under(info_span!(target: SPANS, parent: None, "send scene"), trace);
        let span = trace.map_or_else(Span::none, |_| sending());
        tokio::task::spawn_blocking(move || {
            let _fetching = (fetching, span);
            for data in SceneEncoder::new(&scene, SCENE_PIECE_BYTES) {
                if sender.blocking_send(Ok(ScenePiece { data })).is_err() {
                    return;
                }
            }
        });
        Ok(Response::new(ReceiverStream::new(pieces)))
    }
}
