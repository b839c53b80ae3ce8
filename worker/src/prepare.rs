//! A job made ready: its scene fetched unless it is here, prepared, and what renders it set up.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use sha2::{Digest, Sha256};
use tessera_core::scene::Scene;
use tessera_core::trace::PreparedScene;
use tessera_proto::convert::Job;
use tessera_proto::scene::SceneDecoder;
use tessera_proto::{JobNumber, SceneHash, SessionId, TraceContext, wire};
use tokio::sync::mpsc;
use tokio::time::timeout;
use tonic::{Code, Request};
use tracing::info_span;

use crate::memory::{prepared_bytes, too_large};
use crate::render::JobTracer;
use crate::renderer::TileTracer;
use crate::session::{Client, Outcome, Session};
use crate::spans::{SPANS, context_of, under};

/// How long a piece of the scene may take to come.
const PIECE_WITHIN: Duration = Duration::from_secs(30);

/// A job that is being made ready. Dropping it stops that, but for a scene that is being prepared already.
pub(crate) type Preparing<'a> = Pin<Box<dyn Future<Output = Result<Prepared, Outcome>> + Send + 'a>>;

/// What became of it.
pub(crate) enum Prepared {
    Ready(JobNumber, JobTracer),
    /// The job is not for this worker, for this cause.
    Unable(JobNumber, String),
    /// The job ended meanwhile.
    Over,
}

/// Why there is no tracer.
enum NoTracer {
    Unable(String),
    Over,
    Lost(Outcome),
}

impl From<Outcome> for NoTracer {
    fn from(outcome: Outcome) -> Self {
        Self::Lost(outcome)
    }
}

impl Session {
    /// Makes `job` ready, with whatever `client` can fetch for `session`; its spans are under `trace`.
    ///
    /// # Errors
    /// When the session cannot go on.
    pub(crate) async fn prepare(
        &self,
        (job, trace): (Job, Option<TraceContext>),
        client: Client,
        session: SessionId,
    ) -> Result<Prepared, Outcome> {
        match self.tracer((&job, trace), client, session).await {
            Ok(tracer) => {
                let job_tracer = JobTracer { tracer, format: job.pixels, transfer: job.settings.transfer, trace };
                Ok(Prepared::Ready(job.number, job_tracer))
            }
            Err(NoTracer::Unable(cause)) => Ok(Prepared::Unable(job.number, cause)),
            Err(NoTracer::Over) => Ok(Prepared::Over),
            Err(NoTracer::Lost(outcome)) => Err(outcome),
        }
    }

    async fn tracer(
        &self,
        (job, trace): (&Job, Option<TraceContext>),
        client: Client,
        session: SessionId,
    ) -> Result<Arc<dyn TileTracer>, NoTracer> {
        let Some((hash, bytes)) = job.scene else {
            let local = self.config.local.as_ref().ok_or_else(|| Outcome::Lost("there is no scene".into()))?;
            return Ok(local.tracer().await.ok_or(Outcome::Stopped)?);
        };
        let prepared = match self.cache.get(hash, &job.settings) {
            Some((prepared, tracer)) => {
                tracing::info!("the scene is here already");
                if let Some(tracer) = tracer {
                    return Ok(tracer);
                }
                prepared
            }
            None => {
                if let Some(cause) = too_large(bytes, self.config.max_memory) {
                    return Err(NoTracer::Unable(cause));
                }
                self.cache.make_room(prepared_bytes(bytes));
                tracing::info!("fetching scene {hash}, {bytes} bytes");
                let scene = Arc::new(fetch(client, session, (hash, bytes), trace).await?);
                let _span = under(info_span!(target: SPANS, parent: None, "prepare scene"), trace);
                let prepared = Arc::new(self.on_pool(move || PreparedScene::build(scene)).await?);
                self.cache.put(hash, prepared_bytes(bytes), prepared.clone());
                prepared
            }
        };
        let (factory, settings) = (self.config.factory.clone(), job.settings);
        match self.on_pool(move || factory.open(prepared, settings)).await? {
            Ok(tracer) => {
                self.cache.put_tracer(hash, settings, tracer.clone());
                Ok(tracer)
            }
            Err(e) => Err(NoTracer::Unable(format!("the job cannot be rendered here: {e}"))),
        }
    }

    /// Computes on the rendering threads, not on those that keep the connection.
    async fn on_pool<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Result<T, Outcome> {
        let pool = self.pool.clone();
        let done = tokio::task::spawn_blocking(move || pool.install(work)).await;
        done.map_err(|e| Outcome::Lost(format!("the scene could not be prepared: {e}")))
    }
}

/// Fetches a scene and holds it against its hash.
async fn fetch(
    mut client: Client,
    session: SessionId,
    (hash, bytes): (SceneHash, u64),
    trace: Option<TraceContext>,
) -> Result<Scene, NoTracer> {
    let bad = |e: &dyn std::fmt::Display| Outcome::Lost(format!("the scene that came is not sound: {e}"));
    let mut request = Request::new(wire::SceneRequest { session: session.0, scene_sha256: hash.0.to_vec() });
    let span = under(info_span!(target: SPANS, parent: None, "receive scene", bytes), trace);
    if let Some(context) = context_of(&span) {
        context.put(request.metadata_mut());
    }
    let mut pieces = match client.fetch_scene(request).await {
        Ok(pieces) => pieces.into_inner(),
        Err(status) if status.code() == Code::NotFound => return Err(NoTracer::Over),
        Err(status) => return Err(NoTracer::Lost(status.into())),
    };
    // Reading the scene is work for a thread of its own; two pieces wait for it at most.
    let (to_reader, mut to_read) = mpsc::channel::<bytes::Bytes>(2);
    let reader = tokio::task::spawn_blocking(move || {
        let (mut decoder, mut sum) = (SceneDecoder::new(bytes)?, Sha256::new());
        while let Some(piece) = to_read.blocking_recv() {
            sum.update(&piece);
            decoder.push(&piece)?;
        }
        decoder.finish().map(|scene| (scene, SceneHash(sum.finalize().into())))
    });
    loop {
        let piece = timeout(PIECE_WITHIN, pieces.message())
            .await
            .map_err(|_| Outcome::Lost("the scene does not come".into()))?
            .map_err(Outcome::from)?;
        let Some(piece) = piece else { break };
        if to_reader.send(piece.data).await.is_err() {
            break; // The reader says why.
        }
    }
    drop(to_reader);
    let (scene, got) = reader.await.map_err(|e| bad(&e))?.map_err(|e| bad(&e))?;
    if got == hash { Ok(scene) } else { Err(bad(&"its hash differs").into()) }
}
