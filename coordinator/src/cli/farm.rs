//! A farm that stays, as its users' commands reach it.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use bytes::Bytes;
use coordinator::access::State;
use coordinator::journal::Partial;
use coordinator::{PixelFormat, Pixels};
use tessera_core::film::Region;
use tessera_core::scene::Scene;
use tessera_core::settings::Settings;
use tessera_proto::control::control_client::ControlClient;
use tessera_proto::control::{
    self, FetchRequest, Job, JobName, ListJobsRequest, ListWorkersRequest, PictureForm, ScenePart, Spec, Worker,
    picture_part, scene_part,
};
use tessera_proto::convert::cause;
use tessera_proto::limits::{MAX_MESSAGE_BYTES, SCENE_PIECE_BYTES};
use tessera_proto::scene::{SceneEncoder, describe};
use tessera_proto::token::Token;
use tessera_proto::wire;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::Channel;
use tonic::{Code, Request, Status, Streaming};
use tracing::Span;
use worker::spans::context_of;
use worker::{Access, Address, Credentials};

use super::args::FarmFlags;
use super::exit::{Exit, Failure};
use super::runtime::blocking;

/// The variables that may name the farm and hold the token.
const FARM_VARIABLE: &str = "TESSERA_FARM";
const TOKEN_VARIABLE: &str = "TESSERA_TOKEN";
/// How long the farm may take to be reached.
const CONNECT_WITHIN: Duration = Duration::from_secs(10);

/// What is to become of a job.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Change {
    Pause,
    Resume,
    Cancel,
}

/// A connection to a farm.
#[derive(Clone, Debug)]
pub(super) struct Client {
    calls: ControlClient<InterceptedService<Channel, Credentials>>,
}

fn failed(e: impl std::fmt::Display) -> Failure {
    Failure::new(Exit::Failed, e)
}

/// Who listens where a farm is looked for.
pub(super) enum Reached {
    /// A farm that stays.
    Farm(Box<Client>),
    /// One that does not tell how much it has to do: a render of one picture, or a farm without the users' token.
    Silent,
}

/// What a refusal means to whoever typed the command.
fn refused(status: &Status) -> Failure {
    let said = cause(status.message());
    match status.code() {
        Code::InvalidArgument | Code::FailedPrecondition | Code::NotFound => Failure::usage(said),
        Code::Unimplemented => failed("whoever listens there is no farm that stays: 'coordinator serve' is one"),
        Code::Unavailable => failed(format!("the farm is not to be reached: {said}")),
        _ => failed(if said.is_empty() { format!("{:?}", status.code()) } else { said }),
    }
}

/// The token to show: of the file, of the environment, or this user's own, where there is one.
fn token(file: Option<&PathBuf>, to: &Address) -> Result<Option<Token>, Failure> {
    let variable = std::env::var(TOKEN_VARIABLE).ok();
    let given = worker::given_token(None, file.map(PathBuf::as_path), variable.as_deref()).map_err(Failure::usage)?;
    let loopback = matches!(to.host(), "localhost" | "127.0.0.1" | "::1" | "[::1]");
    if given.is_some() || loopback {
        return Ok(given);
    }
    let own = State::of_user().ok().map(|state| state.user_token_path()).filter(|path| path.exists());
    worker::given_token(None, own.as_deref(), None).map_err(Failure::usage)
}

impl Client {
    /// Connects to the farm that the flags or the environment name.
    pub(super) async fn connect(flags: &FarmFlags) -> Result<Self, Failure> {
        let named = || {
            let text = std::env::var(FARM_VARIABLE).ok().filter(|t| !t.is_empty());
            let text =
                text.ok_or_else(|| Failure::usage("which farm? Give --farm HOST[:PORT], or set TESSERA_FARM"))?;
            text.parse().map_err(|e| Failure::usage(format!("{FARM_VARIABLE}: {e}")))
        };
        let to: Address = flags.farm.clone().map_or_else(named, Ok)?;
        let token = token(flags.user_token.as_ref(), &to)?;
        let access = match &token {
            None => Access::open(),
            Some(token) => Access::by_token(token).map_err(Failure::usage)?,
        };
        let dialled = tokio::time::timeout(CONNECT_WITHIN, worker::dial(&access, &to, |endpoint| endpoint)).await;
        let channel = dialled
            .map_err(|_| failed(format!("the farm at {to} does not answer")))?
            .map_err(|e| failed(format!("the farm at {to}: {e}")))?;
        let calls = ControlClient::with_interceptor(channel, Credentials::of(&access))
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES);
        Ok(Self { calls })
    }

    /// Connects to whatever farm is there; `asks`: whether to find out if it tells what it has to do.
    pub(super) async fn reach(flags: &FarmFlags, asks: bool) -> Result<Reached, Failure> {
        let mut client = Self::connect(flags).await?;
        if !asks {
            return Ok(Reached::Silent);
        }
        match client.calls.list_workers(ListWorkersRequest {}).await {
            Ok(_) => Ok(Reached::Farm(Box::new(client))),
            Err(e) if [Code::Unimplemented, Code::Unauthenticated].contains(&e.code()) => Ok(Reached::Silent),
            Err(e) => Err(refused(&e)),
        }
    }

    /// Makes sure that the farm has a scene; gives its name there.
    pub(super) async fn put_scene(&mut self, scene: Arc<Scene>) -> Result<control::Scene, Failure> {
        let named = scene.clone();
        let (hash, bytes) = blocking(move || describe(&named)).await?;
        let name = control::Scene { sha256: hash.0.to_vec(), bytes };
        if self.calls.has_scene(name.clone()).await.map_err(|e| refused(&e))?.into_inner().has {
            return Ok(name);
        }
        let (parts, sent) = mpsc::channel(4);
        let first = name.clone();
        tokio::task::spawn_blocking(move || {
            let part = |part| ScenePart { part: Some(part) };
            if parts.blocking_send(part(scene_part::Part::Scene(first))).is_err() {
                return;
            }
            for data in SceneEncoder::new(&scene, SCENE_PIECE_BYTES) {
                if parts.blocking_send(part(scene_part::Part::Data(data))).is_err() {
                    return;
                }
            }
        });
        let put = self.calls.put_scene(ReceiverStream::new(sent)).await.map_err(|e| refused(&e))?;
        Ok(put.into_inner())
    }

    /// Submits a job, whose spans are to be under `span`.
    pub(super) async fn submit(&mut self, spec: Spec, span: &Span) -> Result<Job, Failure> {
        let mut spec = Request::new(spec);
        if let Some(context) = context_of(span) {
            context.put(spec.metadata_mut());
        }
        Ok(self.calls.submit(spec).await.map_err(|e| refused(&e))?.into_inner())
    }

    pub(super) async fn job(&mut self, id: u64) -> Result<Job, Failure> {
        Ok(self.calls.get_job(JobName { id }).await.map_err(|e| refused(&e))?.into_inner())
    }

    pub(super) async fn jobs(&mut self) -> Result<Vec<Job>, Failure> {
        let jobs = self.calls.list_jobs(ListJobsRequest {}).await.map_err(|e| refused(&e))?;
        all(jobs.into_inner()).await
    }

    pub(super) async fn workers(&mut self) -> Result<Vec<Worker>, Failure> {
        let workers = self.calls.list_workers(ListWorkersRequest {}).await.map_err(|e| refused(&e))?;
        all(workers.into_inner()).await
    }

    pub(super) async fn change(&mut self, id: u64, change: Change) -> Result<Job, Failure> {
        let name = JobName { id };
        let changed = match change {
            Change::Pause => self.calls.pause(name).await,
            Change::Resume => self.calls.resume(name).await,
            Change::Cancel => self.calls.cancel(name).await,
        };
        Ok(changed.map_err(|e| refused(&e))?.into_inner())
    }

    /// The job whenever it changed, until it ends.
    pub(super) async fn watch(&mut self, id: u64) -> Result<Watched, Failure> {
        let watched = self.calls.watch_job(JobName { id }).await.map_err(|e| refused(&e))?;
        Ok(Watched(watched.into_inner()))
    }

    /// A job's picture; `partial`: also one that is not whole.
    pub(super) async fn picture(&mut self, id: u64, partial: bool) -> Result<Partial, Failure> {
        let parts = self.calls.fetch_picture(FetchRequest { id, partial }).await.map_err(|e| refused(&e))?;
        let mut parts = parts.into_inner();
        let unsound = || failed("the farm sends no sound picture");
        let first = parts.message().await.map_err(|e| refused(&e))?.and_then(|p| p.part);
        let Some(picture_part::Part::Form(form)) = first else { return Err(unsound()) };
        let form = Form::read(&form).ok_or_else(unsound)?;
        let mut bytes = Vec::with_capacity(form.pixel_bytes + form.mask_bytes);
        while let Some(part) = parts.message().await.map_err(|e| refused(&e))? {
            let Some(picture_part::Part::Data(data)) = part.part else { return Err(unsound()) };
            if bytes.len() + data.len() > form.pixel_bytes + form.mask_bytes {
                return Err(unsound());
            }
            bytes.extend_from_slice(&data);
        }
        form.picture(&bytes.into()).ok_or_else(unsound)
    }
}

/// A job that is watched.
pub(super) struct Watched(Streaming<Job>);

impl Watched {
    /// How it is next; `None` when it came to its end.
    pub(super) async fn next(&mut self) -> Result<Option<Job>, Failure> {
        self.0.message().await.map_err(|e| refused(&e))
    }
}

async fn all<T>(mut stream: Streaming<T>) -> Result<Vec<T>, Failure> {
    let mut found = Vec::new();
    while let Some(next) = stream.message().await.map_err(|e| refused(&e))? {
        found.push(next);
    }
    Ok(found)
}

/// What a picture is like that comes.
struct Form {
    region: Region,
    format: PixelFormat,
    transfer: tessera_core::settings::Transfer,
    pixel_bytes: usize,
    mask_bytes: usize,
}

impl Form {
    fn read(form: &PictureForm) -> Option<Self> {
        let wire::Region { x0, y0, x1, y1 } = form.region?;
        let region = Region::new(x0, y0, x1, y1)?;
        let format = PixelFormat::try_from(form.pixels()).ok()?;
        let transfer = match form.transfer() {
            wire::Transfer::Srgb => tessera_core::settings::Transfer::Srgb,
            wire::Transfer::Linear => tessera_core::settings::Transfer::Linear,
            wire::Transfer::Unspecified => return None,
        };
        let pixel_bytes = region.area().checked_mul(format.bytes_per_pixel() as u64)?;
        let sound = form.pixel_bytes == pixel_bytes && [0, region.area()].contains(&form.mask_bytes);
        let sizes = (usize::try_from(pixel_bytes).ok()?, usize::try_from(form.mask_bytes).ok()?);
        sound.then_some(Self { region, format, transfer, pixel_bytes: sizes.0, mask_bytes: sizes.1 })
    }

    fn picture(&self, bytes: &Bytes) -> Option<Partial> {
        if bytes.len() != self.pixel_bytes + self.mask_bytes {
            return None;
        }
        let count = usize::try_from(self.region.area()).ok()?;
        let mut image = Pixels::black(self.format, count)?;
        image.put(0, &bytes[..self.pixel_bytes]);
        let present = match self.mask_bytes {
            0 => vec![true; count],
            _ => bytes[self.pixel_bytes..].iter().map(|&b| b != 0).collect(),
        };
        Some(Partial { region: self.region, transfer: self.transfer, image, present, damaged: None })
    }
}

/// The settings, and all else that is asked of a farm.
pub(super) struct Asking<'a> {
    pub(super) settings: Settings,
    pub(super) region: Region,
    pub(super) pixels: PixelFormat,
    pub(super) goal: coordinator::Goal,
    pub(super) tile: coordinator::TileSize,
    pub(super) verify: f64,
    pub(super) name: &'a str,
    pub(super) owner: Option<&'a str>,
    pub(super) priority: i32,
    pub(super) group: &'a str,
    /// From now on.
    pub(super) deadline: Option<Duration>,
}

impl Asking<'_> {
    /// As it is sent.
    pub(super) fn spec(&self, scene: control::Scene) -> Spec {
        let (max_error, limit) = match self.goal {
            coordinator::Goal::AsSet => (0.0, Duration::ZERO),
            coordinator::Goal::Error(e) => (e, Duration::ZERO),
            coordinator::Goal::Time { limit, error } => (error.unwrap_or(0.0), limit.max(Duration::from_micros(1))),
        };
        let Region { x0, y0, x1, y1 } = self.region;
        Spec {
            scene: Some(scene),
            settings: Some(self.settings.into()),
            region: Some(wire::Region { x0, y0, x1, y1 }),
            pixels: wire::PixelFormat::from(self.pixels).into(),
            max_error,
            time_limit_us: u64::try_from(limit.as_micros()).unwrap_or(u64::MAX),
            tile: match self.tile {
                coordinator::TileSize::Auto => 0,
                coordinator::TileSize::Edge(edge) => edge,
            },
            verify: self.verify,
            name: self.name.into(),
            owner: self.owner.map_or_else(user, Into::into),
            priority: self.priority,
            group: self.group.into(),
            deadline_ms: self.deadline.map_or(0, from_now_ms),
            traceparent: String::new(),
        }
    }
}

/// A moment in milliseconds since 1970.
fn from_now_ms(later: Duration) -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from((now + later).as_millis()).unwrap_or(u64::MAX)
}

/// Who types the commands.
fn user() -> String {
    let named = ["USER", "LOGNAME", "USERNAME"].into_iter().find_map(|name| std::env::var(name).ok());
    named.filter(|name| !name.trim().is_empty()).unwrap_or_else(|| "somebody".into())
}
