//! One connection to a coordinator, from dialling to the end of its stream.

use std::error::Error as _;
use std::sync::Arc;
use std::time::Duration;

use hyper_util::rt::TokioIo;
use rayon::ThreadPool;
use tessera_proto::convert::{Job, Lease, Registration, cause};
use tessera_proto::identity::Identity;
use tessera_proto::limits::{
    KEEPALIVE_INTERVAL, KEEPALIVE_TIMEOUT, MAX_MESSAGE_BYTES, MAX_NAME_BYTES, REGISTER_WITHIN, cut,
};
use tessera_proto::token::REFUSED_KEY;
use tessera_proto::wire::farm_client::FarmClient;
use tessera_proto::wire::worker_message::Kind as Say;
use tessera_proto::wire::{self, CoordinatorMessage, WorkerMessage, coordinator_message::Kind as Hear};
use tessera_proto::{LeaseId, SceneHash, SessionId, TraceContext};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio::time::timeout;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Request, Status, Streaming};
use tracing::{Span, info_span};

use crate::cache::SceneCache;
use crate::heartbeat::beat;
use crate::prepare::{Prepared, Preparing};
use crate::render::LeaseQueue;
use crate::spans::{SPANS, context_of, under};
use crate::{Access, Address, Config};

/// Bytes of a scene on their way at most: an ocean away, a smaller window would be the limit.
const WINDOW: u32 = 16 << 20;
/// Deliveries that wait for the network, beside the ones at work.
const DELIVERIES: usize = 4;
/// How long the coordinator may take to end its side.
const GOODBYE_WITHIN: Duration = Duration::from_secs(2);

/// What sessions of one worker have in common.
pub(crate) struct Session {
    pub(crate) identity: Identity,
    pub(crate) pool: Arc<ThreadPool>,
    pub(crate) cache: SceneCache,
    pub(crate) config: Config,
}

/// How a session ended.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// There is no more work.
    Finished,
    /// Somebody had this worker leave.
    Dismissed,
    /// This worker was asked to stop.
    Stopped,
    /// Not wanted, for good.
    Refused(String),
    /// Not to be had, or lost; worth another try.
    Lost(String),
}

impl From<Status> for Outcome {
    fn from(status: Status) -> Self {
        match status.code() {
            // Any other service at this port may say no: only a coordinator can say that it is for good.
            _ if status.metadata().contains_key(REFUSED_KEY) => Self::Refused(cause(status.message())),
            Code::Unimplemented => Self::Lost("whoever listens there is no coordinator of this release".into()),
            _ => Self::Lost(in_words(&status)),
        }
    }
}

/// What became of a call, for people: what a coordinator says as it is; of what failed on the way only that, and
/// what lies beneath to whoever asks for it.
fn in_words(status: &Status) -> String {
    if status.source().is_none() {
        return says(status);
    }
    let raw = says(status);
    tracing::debug!("{raw}");
    // Whoever answers in another protocol is taken for frames without sense.
    if ["frame with invalid size", "invalid HTTP version", "invalid preface"].iter().any(|what| raw.contains(what)) {
        "whoever listens there is no coordinator".into()
    } else {
        "connection lost".into()
    }
}

/// What a status says, with what lies beneath it.
pub(crate) fn says(status: &Status) -> String {
    let text = with_causes(cause(status.message()), status.source());
    if text.is_empty() { format!("{:?}", status.code()) } else { text }
}

/// `text` and what lies beneath it, everything once.
fn with_causes(mut text: String, mut source: Option<&(dyn std::error::Error + 'static)>) -> String {
    while let Some(s) = source {
        let more = s.to_string();
        if !text.contains(&more) {
            text = if text.is_empty() { more } else { format!("{text}: {more}") };
        }
        source = s.source();
    }
    text
}

/// Ends a task when nobody is left to wait for it.
struct Ended(AbortHandle);

impl Drop for Ended {
    fn drop(&mut self) {
        self.0.abort();
    }
}

impl Session {
    /// Works until the stream ends. Also says whether the coordinator welcomed this worker.
    pub(crate) async fn run(&self, stop: &CancellationToken) -> (bool, Outcome) {
        let mut welcomed = false;
        let connect = async {
            let channel = self.dial().await?;
            if let Some(local) = &self.config.local {
                local.tracer().await.ok_or(Outcome::Stopped)?;
            }
            self.register(channel).await
        };
        let registered = tokio::select! {
            registered = connect => registered,
            () = stop.cancelled() => return (false, Outcome::Stopped),
        };
        let outcome = match registered {
            Ok(talk) => {
                welcomed = true;
                talk.work(self, stop).await.unwrap_or_else(|outcome| outcome)
            }
            Err(outcome) => outcome,
        };
        (welcomed, outcome)
    }

    async fn dial(&self) -> Result<Channel, Outcome> {
        let endpoint =
            |endpoint: Endpoint| endpoint.initial_stream_window_size(WINDOW).initial_connection_window_size(WINDOW);
        dial(&self.config.access, &self.config.connect, endpoint).await.map_err(Outcome::Lost)
    }

    /// What calls over `channel`.
    fn client(&self, channel: Channel) -> Client {
        FarmClient::with_interceptor(channel, Credentials::of(&self.config.access))
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES)
    }

    async fn register(&self, channel: Channel) -> Result<Talk, Outcome> {
        let mut client = self.client(channel);
        let (out, outbox) = mpsc::channel(DELIVERIES);
        let talk = async {
            let challenge = client.greet(wire::GreetRequest {}).await?.into_inner().challenge;
            let challenge = challenge.try_into().map_err(|_| Outcome::Lost("a bad challenge".into()))?;
            let registration = Registration {
                name: cut(&self.config.name, MAX_NAME_BYTES).into(),
                threads: self.pool.current_num_threads() as u32,
                id: self.identity.id(),
                proof: self.identity.prove(&challenge),
                local: self.config.local.as_ref().map(|l| l.secret),
            };
            say(&out, Say::Register(registration.into())).await?;
            let answer = client.work(ReceiverStream::new(outbox)).await?;
            let farm = TraceContext::of(answer.metadata());
            let mut inbox = answer.into_inner();
            match hear(&mut inbox).await? {
                Some(Hear::Welcome(welcome)) => Ok((inbox, welcome, farm)),
                _ => Err(Outcome::Lost("the coordinator did not answer as one".into())),
            }
        };
        let no_answer = || Outcome::Lost("the coordinator does not answer".into());
        let (inbox, welcome, farm) = timeout(2 * REGISTER_WITHIN, talk).await.map_err(|_| no_answer())??;
        tracing::info!("registered with {} as {:?}", self.config.connect, cause(&welcome.name));
        let name = cause(&welcome.name);
        let span = under(info_span!(target: SPANS, parent: None, "session", worker = name), farm);
        let millis = |ms: u32| Duration::from_millis(u64::from(ms.clamp(50, 60_000)));
        let session = SessionId(welcome.session);
        // On a connection of their own, beats do not wait behind results.
        let beats = match &self.config.local {
            Some(_) => client.clone(),
            None => self.client(timeout(REGISTER_WITHIN, self.dial()).await.map_err(|_| no_answer())??),
        };
        let heart = beat(beats, session, millis(welcome.heartbeat_interval_ms), millis(welcome.dead_after_ms));
        Ok(Talk { client, session, span, out, inbox, heart: tokio::spawn(heart) })
    }
}

/// Connects to a coordinator over HTTP/2, and keeps asking whether it is there.
///
/// # Errors
/// Why there is no connection, in people's words.
pub async fn dial(access: &Access, to: &Address, tune: impl FnOnce(Endpoint) -> Endpoint) -> Result<Channel, String> {
    // A name may come to be known later, as its machine does.
    to.resolve().await.map_err(|e| e.to_string())?;
    let endpoint = Endpoint::from_shared(format!("http://{to}"))
        .map_err(|e| e.to_string())?
        .connect_timeout(REGISTER_WITHIN)
        .http2_keep_alive_interval(KEEPALIVE_INTERVAL)
        .keep_alive_timeout(KEEPALIVE_TIMEOUT)
        .keep_alive_while_idle(true);
    let (access, to) = (access.clone(), to.clone());
    let connect = tower::service_fn(move |_| {
        let (access, to) = (access.clone(), to.clone());
        async move { access.connect(&to).await.map(TokioIo::new) }
    });
    tune(endpoint).connect_with_connector(connect).await.map_err(|e| {
        // What lies deepest, said by the operating system or of the other side, is what people know.
        let deepest = std::iter::successors(e.source(), |&e| e.source()).last();
        let cause = deepest.map_or_else(|| e.to_string(), ToString::to_string);
        format!("cannot connect: {}", cause.split(" (os error").next().unwrap_or_default())
    })
}

/// Puts the secret into every call.
#[derive(Clone, Debug)]
pub struct Credentials(Option<MetadataValue<Ascii>>);

impl Credentials {
    /// Those of `access`.
    #[must_use]
    pub fn of(access: &Access) -> Self {
        Self(access.authorization())
    }
}

impl tonic::service::Interceptor for Credentials {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(value) = &self.0 {
            request.metadata_mut().insert("authorization", value.clone());
        }
        Ok(request)
    }
}

/// What calls the coordinator.
pub(crate) type Client = FarmClient<InterceptedService<Channel, Credentials>>;

/// A session that the coordinator welcomed.
struct Talk {
    client: Client,
    session: SessionId,
    /// The session, as it is exported.
    span: Span,
    out: mpsc::Sender<WorkerMessage>,
    inbox: Streaming<CoordinatorMessage>,
    heart: tokio::task::JoinHandle<String>,
}

async fn say(out: &mpsc::Sender<WorkerMessage>, kind: Say) -> Result<(), Outcome> {
    let sent = out.send(WorkerMessage { kind: Some(kind) }).await;
    sent.map_err(|_| Outcome::Lost("the coordinator closed the connection".into()))
}

/// The coordinator's next message; `None` at the end of its stream.
async fn hear(inbox: &mut Streaming<CoordinatorMessage>) -> Result<Option<Hear>, Outcome> {
    match inbox.message().await? {
        None => Ok(None),
        Some(CoordinatorMessage { kind: Some(kind) }) => Ok(Some(kind)),
        Some(_) => Err(Outcome::Lost("the coordinator says what this worker does not know".into())),
    }
}

impl Talk {
    async fn work(mut self, session: &Session, stop: &CancellationToken) -> Result<Outcome, Outcome> {
        let _heart = Ended(self.heart.abort_handle());
        let foreman = LeaseQueue::new(session.pool.clone(), self.out.clone());
        // The job that comes next, while it is made ready; what comes meanwhile is heard.
        let mut next: Option<Preparing<'_>> = None;
        loop {
            tokio::select! {
                biased;
                () = stop.cancelled() => return self.drain(foreman, session.config.leave_within).await,
                heart = &mut self.heart => {
                    return Err(Outcome::Lost(heart.unwrap_or_else(|e| e.to_string())));
                }
                prepared = async { next.as_mut().map_or_else(|| unreachable!("guarded"), |p| p.as_mut()).await },
                    if next.is_some() =>
                {
                    next = None;
                    answer(&self.out, &foreman, prepared?).await?;
                }
                heard = hear(&mut self.inbox) => match heard? {
                    None => return Err(Outcome::Lost("the coordinator closed the connection".into())),
                    Some(Hear::Finished(wire::Finished { leave: true })) => return Ok(Outcome::Dismissed),
                    Some(Hear::Finished(_)) => return Ok(Outcome::Finished),
                    Some(Hear::Job(job)) => {
                        let trace = TraceContext::parse(&job.traceparent).or_else(|| context_of(&self.span));
                        let job = Job::try_from(job).map_err(|e| Outcome::Lost(format!("a bad job: {e}")))?;
                        for lease in foreman.turn_to(None) {
                            give_back(&self.out, &lease).await?;
                        }
                        next = Some(Box::pin(session.prepare((job, trace), self.client.clone(), self.session)));
                    }
                    Some(Hear::Forget(forget)) => {
                        if let Ok(hash) = forget.scene_sha256.try_into() {
                            session.cache.forget(SceneHash(hash));
                        }
                    }
                    Some(Hear::Lease(lease)) => {
                        foreman.pack(lease.pack);
                        let span = lease.span;
                        let lease = Lease::try_from(lease).map_err(|e| Outcome::Lost(format!("a bad lease: {e}")))?;
                        if !foreman.take(lease, span) {
                            let why = "the coordinator sends more leases than anyone can hold, or before a job is ready";
                            return Err(Outcome::Lost(why.into()));
                        }
                    }
                    Some(Hear::Revoke(revoke)) => {
                        if let Some(lease) = foreman.revoke(LeaseId(revoke.lease)) {
                            give_back(&self.out, &lease).await?;
                        }
                    }
                    Some(Hear::Welcome(_)) => return Err(Outcome::Lost("the coordinator repeats itself".into())),
                },
            }
        }
    }

    /// Leaves in order: returns what was not begun, delivers what ends within `patience`, returns the rest, and
    /// ends this half.
    async fn drain(mut self, foreman: LeaseQueue, patience: Duration) -> Result<Outcome, Outcome> {
        tracing::info!("leaving after the tile at work");
        say(&self.out, Say::Draining(wire::Draining {})).await?;
        for lease in foreman.clear() {
            give_back(&self.out, &lease).await?;
        }
        let mut look = tokio::time::interval(Duration::from_millis(5));
        let enough = tokio::time::sleep(patience);
        tokio::pin!(enough);
        while !foreman.is_still() {
            tokio::select! {
                () = &mut enough => {
                    tracing::warn!("the tile at work takes too long: it is given back");
                    for lease in foreman.give_up() {
                        give_back(&self.out, &lease).await?;
                    }
                    break;
                }
                _ = look.tick() => {}
                heart = &mut self.heart => return Err(Outcome::Lost(heart.unwrap_or_else(|e| e.to_string()))),
                heard = hear(&mut self.inbox) => match heard? {
                    None | Some(Hear::Finished(_)) => return Ok(Outcome::Stopped),
                    Some(Hear::Lease(lease)) => {
                        if let Ok(lease) = Lease::try_from(lease) {
                            give_back(&self.out, &lease).await?;
                        }
                    }
                    Some(_) => {}
                },
            }
        }
        // It holds an end of the outgoing stream too.
        drop(foreman);
        let Self { out, mut inbox, heart, .. } = self;
        let _heart = Ended(heart.abort_handle());
        // Leases may still be on the way; they are returned until the coordinator is done.
        let rest = async {
            let mut out = Some(out);
            loop {
                let quiet = timeout(Duration::from_millis(50), hear(&mut inbox)).await;
                match quiet {
                    Ok(Ok(Some(Hear::Lease(lease)))) => {
                        if let (Ok(lease), Some(out)) = (Lease::try_from(lease), &out) {
                            give_back(out, &lease).await?;
                        }
                    }
                    Ok(Ok(Some(_))) => {}
                    Ok(Ok(None) | Err(_)) => return Ok(()),
                    Err(_) => out = None,
                }
            }
        };
        let _: Result<Result<(), Outcome>, _> = timeout(GOODBYE_WITHIN, rest).await;
        Ok(Outcome::Stopped)
    }
}

async fn give_back(out: &mpsc::Sender<WorkerMessage>, lease: &Lease) -> Result<(), Outcome> {
    say(out, Say::LeaseReturned(wire::LeaseReturned { lease: lease.id.0, attempt: lease.attempt.0 })).await
}

/// Says that a job is ready, or why it never will be here.
async fn answer(out: &mpsc::Sender<WorkerMessage>, foreman: &LeaseQueue, prepared: Prepared) -> Result<(), Outcome> {
    match prepared {
        Prepared::Ready(number, job) => {
            foreman.turn_to(Some(job));
            say(out, Say::Ready(wire::Ready { job: number.0 })).await
        }
        Prepared::Unable(number, cause) => {
            tracing::warn!("{cause}");
            say(out, Say::Unable(wire::Unable { job: number.0, cause })).await
        }
        // Another job comes, or the end.
        Prepared::Over => Ok(()),
    }
}
