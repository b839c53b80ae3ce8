//! A farm that stays, as its users see it: the gRPC service, and the queue that the farm renders for.

use std::io::Read;
use std::time::Duration;

use bytes::Bytes;
use sha2::{Digest, Sha256};
use tessera_proto::control::control_server::{self, ControlServer};
use tessera_proto::control::{
    FetchRequest, HasSceneReply, Job, JobName, ListJobsRequest, ListWorkersRequest, PictureForm, PicturePart, Scene,
    ScenePart, Spec, State, Worker, WorkerName, picture_part, scene_part,
};
use tessera_proto::convert::pixel_bytes;
use tessera_proto::limits::{MAX_MESSAGE_BYTES, MAX_SCENE_BYTES, SCENE_PIECE_BYTES};
use tessera_proto::scene::SceneDecoder;
use tessera_proto::{SceneHash, TraceContext, wire};
use tokio::sync::mpsc;
use tokio::time::timeout;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::{Request, Response, Status, Streaming};

use crate::access::Access;
use crate::config::ListenAddr;
use crate::error::RenderError;
use crate::farm::{Farm, UserGate};
use crate::journal::Partial;
use crate::queue::{Change, Orders, Queue, Refused, is_final, region_of, state_name, write_whole};

/// How long the next piece of a scene may take to come.
const PIECE_WITHIN: Duration = Duration::from_secs(30);
/// Between two words about a job.
const WATCH_EVERY: Duration = Duration::from_millis(100);
/// A word about a job comes so often even where nothing changed, so that a connection is known to live.
const SAY_EVERY: u32 = 10;
/// Jobs that are listed at a time.
const PAGE: usize = 256;

/// See the [module](self).
#[derive(Clone)]
struct Control {
    queue: Queue,
    gate: UserGate,
}

impl From<Refused> for Status {
    fn from(refused: Refused) -> Self {
        let said = refused.to_string();
        match refused {
            Refused::Unknown(_) => Self::not_found(said),
            Refused::NoScene | Refused::State(..) | Refused::Single(_) => Self::failed_precondition(said),
            Refused::Bad(_) => Self::invalid_argument(said),
            Refused::Disk(_) => Self::resource_exhausted(said),
            Refused::Closing => Self::unavailable(said),
        }
    }
}

impl Farm {
    /// As [`Farm::bind_guarded`], and also answers the users of `queue`, for [`Farm::serve`].
    ///
    /// # Errors
    /// [`RenderError::Listen`] when the address is taken or not of this machine.
    pub async fn bind_serving(listen: ListenAddr, access: &Access, queue: &Queue) -> Result<Self, RenderError> {
        let queue = queue.clone();
        Self::bind_for(listen, access, |gate, services| services.add_service(Control { queue, gate }.into_server()))
            .await
    }

    /// Renders what the queue orders until `cancel`; then every job ends as it is, and the workers are dismissed.
    pub async fn serve(self, queue: &Queue, orders: Orders, cancel: CancellationToken) {
        self.obey(orders.0, |views| queue.attach(views), (queue.closing(), cancel)).await;
    }
}

impl Control {
    fn into_server(self) -> ControlServer<Self> {
        ControlServer::new(self)
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES)
    }

    async fn change(&self, request: Request<JobName>, change: Change) -> Result<Response<Job>, Status> {
        self.gate.called(&request)?;
        Ok(Response::new(self.queue.change(request.get_ref().id, change).await?))
    }
}

type Answers<T> = ReceiverStream<Result<T, Status>>;

#[tonic::async_trait]
impl control_server::Control for Control {
    type ListJobsStream = Answers<Job>;
    type WatchJobStream = Answers<Job>;
    type FetchPictureStream = Answers<PicturePart>;
    type ListWorkersStream = Answers<Worker>;

    async fn has_scene(&self, request: Request<Scene>) -> Result<Response<HasSceneReply>, Status> {
        self.gate.called(&request)?;
        let (hash, _) = named(request.get_ref())?;
        Ok(Response::new(HasSceneReply { has: self.queue.scene_path(hash).exists() }))
    }

    async fn put_scene(&self, request: Request<Streaming<ScenePart>>) -> Result<Response<Scene>, Status> {
        let _in_use = self.gate.called(&request)?.in_use();
        let mut parts = request.into_inner();
        let next = |part: Result<Result<Option<ScenePart>, Status>, _>| -> Result<Option<ScenePart>, Status> {
            part.map_err(|_| Status::deadline_exceeded("the scene does not come"))?
        };
        let first = next(timeout(PIECE_WITHIN, parts.message()).await)?.and_then(|p| p.part);
        let Some(scene_part::Part::Scene(scene)) = first else {
            return Err(Status::invalid_argument("a scene is named first"));
        };
        let (hash, bytes) = named(&scene)?;
        let path = self.queue.scene_path(hash);
        let (pieces, mut come) = mpsc::channel::<Bytes>(2);
        let written = tokio::task::spawn_blocking(move || {
            write_whole(&path, |file| {
                let unsound =
                    |e: &dyn std::fmt::Display| std::io::Error::new(std::io::ErrorKind::InvalidData, e.to_string());
                let mut decoder = SceneDecoder::new(bytes).map_err(|e| unsound(&e))?;
                let mut sum = Sha256::new();
                while let Some(piece) = come.blocking_recv() {
                    sum.update(&piece);
                    decoder.push(&piece).map_err(|e| unsound(&e))?;
                    std::io::Write::write_all(file, &piece)?;
                }
                decoder.finish().map_err(|e| unsound(&e))?;
                let got: [u8; 32] = sum.finalize().into();
                if got == hash.0 { Ok(()) } else { Err(unsound(&"the hash is another one")) }
            })
        });
        while let Some(part) = next(timeout(PIECE_WITHIN, parts.message()).await)? {
            let Some(scene_part::Part::Data(data)) = part.part else {
                return Err(Status::invalid_argument("a scene is named once"));
            };
            if pieces.send(data).await.is_err() {
                break; // Whoever writes says why.
            }
        }
        drop(pieces);
        let written = written.await.map_err(|e| Status::internal(e.to_string()))?;
        written.map_err(|e| match e.kind() {
            std::io::ErrorKind::InvalidData => Status::invalid_argument(format!("the scene is not sound: {e}")),
            _ => Status::resource_exhausted(format!("the scene cannot be kept: {e}")),
        })?;
        Ok(Response::new(scene))
    }

    async fn submit(&self, request: Request<Spec>) -> Result<Response<Job>, Status> {
        self.gate.called(&request)?;
        let submitted = TraceContext::of(request.metadata());
        let traceparent = submitted.map_or_else(String::new, |context| context.to_string());
        Ok(Response::new(self.queue.submit(Spec { traceparent, ..request.into_inner() }).await?))
    }

    async fn list_jobs(&self, request: Request<ListJobsRequest>) -> Result<Response<Self::ListJobsStream>, Status> {
        let in_use = self.gate.called(&request)?.in_use();
        let (out, jobs) = mpsc::channel(16);
        let queue = self.queue.clone();
        tokio::spawn(async move {
            let _in_use = in_use;
            let mut after = 0;
            loop {
                let page = queue.list(after, PAGE);
                let Some(last) = page.last().map(|j| j.id) else { return };
                for job in page {
                    if out.send(Ok(job)).await.is_err() {
                        return;
                    }
                }
                after = last;
            }
        });
        Ok(Response::new(ReceiverStream::new(jobs)))
    }

    async fn get_job(&self, request: Request<JobName>) -> Result<Response<Job>, Status> {
        self.gate.called(&request)?;
        Ok(Response::new(self.queue.job(request.get_ref().id)?))
    }

    async fn watch_job(&self, request: Request<JobName>) -> Result<Response<Self::WatchJobStream>, Status> {
        let in_use = self.gate.called(&request)?.in_use();
        let id = request.get_ref().id;
        let first = self.queue.job(id)?;
        let (out, jobs) = mpsc::channel(2);
        let queue = self.queue.clone();
        tokio::spawn(async move {
            let _in_use = in_use;
            let (mut job, mut quiet) = (first, 0);
            let mut said: Option<Job> = None;
            loop {
                if said.as_ref() != Some(&job) || quiet >= SAY_EVERY {
                    if out.send(Ok(job.clone())).await.is_err() {
                        return;
                    }
                    if is_final(job.state()) {
                        return;
                    }
                    (said, quiet) = (Some(job), 0);
                }
                tokio::select! {
                    () = tokio::time::sleep(WATCH_EVERY) => {}
                    () = out.closed() => return,
                }
                quiet += 1;
                job = match queue.job(id) {
                    Ok(job) => job,
                    Err(e) => return drop(out.send(Err(e.into())).await),
                };
            }
        });
        Ok(Response::new(ReceiverStream::new(jobs)))
    }

    async fn pause(&self, request: Request<JobName>) -> Result<Response<Job>, Status> {
        self.change(request, Change::Pause).await
    }

    async fn resume(&self, request: Request<JobName>) -> Result<Response<Job>, Status> {
        self.change(request, Change::Resume).await
    }

    async fn cancel(&self, request: Request<JobName>) -> Result<Response<Job>, Status> {
        self.change(request, Change::Cancel).await
    }

    async fn fetch_picture(
        &self,
        request: Request<FetchRequest>,
    ) -> Result<Response<Self::FetchPictureStream>, Status> {
        let in_use = self.gate.called(&request)?.in_use();
        let FetchRequest { id, partial } = *request.get_ref();
        let job = self.queue.job(id)?;
        if job.state() != State::Done && !partial {
            let state = state_name(job.state());
            return Err(Status::failed_precondition(format!("job {id} is {state}: its picture is not whole")));
        }
        let queue = self.queue.clone();
        let (out, parts) = mpsc::channel(2);
        tokio::task::spawn_blocking(move || {
            let _in_use = in_use;
            if let Err(status) = send_picture(&queue, &job, &out) {
                let _ = out.blocking_send(Err(status));
            }
        });
        Ok(Response::new(ReceiverStream::new(parts)))
    }

    async fn list_workers(
        &self,
        request: Request<ListWorkersRequest>,
    ) -> Result<Response<Self::ListWorkersStream>, Status> {
        let in_use = self.gate.called(&request)?.in_use();
        let (out, workers) = mpsc::channel(16);
        let queue = self.queue.clone();
        tokio::spawn(async move {
            let _in_use = in_use;
            for worker in queue.workers() {
                if out.send(Ok(worker)).await.is_err() {
                    return;
                }
            }
        });
        Ok(Response::new(ReceiverStream::new(workers)))
    }

    async fn drain_worker(&self, request: Request<WorkerName>) -> Result<Response<WorkerName>, Status> {
        self.gate.called(&request)?;
        let name = request.into_inner();
        if self.queue.drain(&name.name).await {
            Ok(Response::new(name))
        } else {
            Err(Status::not_found("there is no worker of this name"))
        }
    }
}

fn named(scene: &Scene) -> Result<(SceneHash, u64), Status> {
    let hash = scene.sha256.as_slice().try_into().map_err(|_| Status::invalid_argument("the scene's hash is bad"))?;
    if scene.bytes > MAX_SCENE_BYTES {
        return Err(Status::invalid_argument("the scene is too long"));
    }
    Ok((SceneHash(hash), scene.bytes))
}

/// Sends a job's picture, piece by piece.
fn send_picture(queue: &Queue, job: &Job, out: &mpsc::Sender<Result<PicturePart, Status>>) -> Result<(), Status> {
    let spec = job.spec.as_ref().ok_or_else(|| Status::internal("a job without a spec"))?;
    let settings = spec.settings.ok_or_else(|| Status::internal("a job without settings"))?;
    let core = tessera_core::settings::Settings::try_from(settings).map_err(|e| Status::internal(e.to_string()))?;
    let region = region_of(spec.region.as_ref(), &core).ok_or_else(|| Status::internal("a job without a region"))?;
    let say = |part| out.blocking_send(Ok(PicturePart { part: Some(part) })).is_ok();
    let form = |pixel_bytes, mask_bytes| {
        let region = wire::Region { x0: region.x0, y0: region.y0, x1: region.x1, y1: region.y1 };
        let (pixels, transfer) = (spec.pixels, settings.transfer);
        picture_part::Part::Form(PictureForm { region: Some(region), pixels, transfer, pixel_bytes, mask_bytes })
    };
    if job.state() == State::Done {
        let path = queue.pixels_path(job).ok_or_else(|| Status::internal("a job without a result"))?;
        let gone = |e: std::io::Error| Status::data_loss(format!("the picture cannot be read: {e}"));
        let mut file = std::fs::File::open(path).map_err(gone)?;
        let length = file.metadata().map_err(gone)?.len();
        if !say(form(length, 0)) {
            return Ok(());
        }
        let mut piece = vec![0; SCENE_PIECE_BYTES];
        loop {
            let read = file.read(&mut piece).map_err(gone)?;
            if read == 0 {
                break;
            }
            if !say(picture_part::Part::Data(Bytes::copy_from_slice(&piece[..read]))) {
                return Ok(());
            }
        }
        queue.fetched(job.id);
        return Ok(());
    }
    let nothing = |e: &dyn std::fmt::Display| Status::failed_precondition(format!("nothing is done of it yet ({e})"));
    let partial = Partial::read(&queue.journal_path(job.id)).map_err(|e| nothing(&e))?;
    let pixels = pixel_bytes(&partial.image);
    let mask: Bytes = partial.present.iter().map(|&p| u8::from(p)).collect::<Vec<u8>>().into();
    if !say(form(pixels.len() as u64, mask.len() as u64)) {
        return Ok(());
    }
    for bytes in [pixels, mask] {
        for start in (0..bytes.len()).step_by(SCENE_PIECE_BYTES) {
            let piece = bytes.slice(start..bytes.len().min(start + SCENE_PIECE_BYTES));
            if !say(picture_part::Part::Data(piece)) {
                return Ok(());
            }
        }
    }
    Ok(())
}
