//! Jobs and workers as JSON.

use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use tessera_proto::control::{Job, Worker};

use super::source::Source;
use super::{Refusal, Site, log, refusal};
use crate::queue::{Change, Refused, state_name};

/// Jobs, workers and tiles that one answer holds, at most.
const PAGE: usize = 500;
const TILES: usize = 2000;

impl From<Refused> for Refusal {
    fn from(refused: Refused) -> Self {
        let status = match refused {
            Refused::Unknown(_) => StatusCode::NOT_FOUND,
            Refused::NoScene | Refused::State(..) | Refused::Single(_) => StatusCode::CONFLICT,
            Refused::Bad(_) => StatusCode::BAD_REQUEST,
            Refused::Disk(_) => StatusCode::INSUFFICIENT_STORAGE,
            Refused::Closing => StatusCode::SERVICE_UNAVAILABLE,
        };
        refusal(status, refused)
    }
}

/// A path's part, or why it is none.
pub(super) type Id = Result<Path<u64>, PathRejection>;

pub(super) fn id(id: Id) -> Result<u64, Refusal> {
    id.map(|Path(id)| id).map_err(|_| refusal(StatusCode::NOT_FOUND, "a job is named by its number"))
}

/// Which jobs.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Which {
    after: Option<u64>,
    limit: Option<usize>,
}

/// Jobs in the order in which they came; the newest ones where none is named.
pub(super) async fn jobs(State(site): State<Site>, which: Result<Query<Which>, QueryRejection>) -> Response {
    let Ok(Query(which)) = which else {
        return refusal(StatusCode::BAD_REQUEST, "after and limit are numbers").into_response();
    };
    let limit = which.limit.unwrap_or(100).clamp(1, PAGE);
    let jobs = match which.after {
        Some(after) => site.farm.list(after, limit),
        None => site.farm.latest(limit),
    };
    let jobs: Vec<Value> = jobs.iter().map(|job| job_json(&*site.farm, job)).collect();
    Json(json!({ "jobs": jobs, "counts": site.farm.counts() })).into_response()
}

pub(super) async fn job(State(site): State<Site>, named: Id) -> Result<Json<Value>, Refusal> {
    let job = site.farm.job(id(named)?)?;
    Ok(Json(job_json(&*site.farm, &job)))
}

async fn change(site: &Site, named: Id, change: Change) -> Result<Json<Value>, Refusal> {
    let job = site.farm.change(id(named)?, change).await?;
    Ok(Json(job_json(&*site.farm, &job)))
}

pub(super) async fn pause(State(site): State<Site>, named: Id) -> Result<Json<Value>, Refusal> {
    change(&site, named, Change::Pause).await
}

pub(super) async fn resume(State(site): State<Site>, named: Id) -> Result<Json<Value>, Refusal> {
    change(&site, named, Change::Resume).await
}

pub(super) async fn cancel(State(site): State<Site>, named: Id) -> Result<Json<Value>, Refusal> {
    change(&site, named, Change::Cancel).await
}

/// From which tile on.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Since {
    since: Option<u64>,
}

/// Who rendered the tiles of a job that is being rendered, and what they cost.
pub(super) async fn tiles(
    State(site): State<Site>,
    named: Id,
    since: Result<Query<Since>, QueryRejection>,
) -> Result<Json<Value>, Refusal> {
    let number = id(named)?;
    site.farm.job(number)?;
    let Ok(Query(since)) = since else { return Err(refusal(StatusCode::BAD_REQUEST, "since is a number")) };
    let canvas = site.farm.canvas(number);
    let (first, notes) = canvas.map_or((0, Vec::new()), |canvas| canvas.notes(since.since.unwrap_or(0), TILES));
    let tiles: Vec<Value> = notes
        .iter()
        .map(|n| {
            let r = n.region;
            json!({
                "region": [r.x0, r.y0, r.x1, r.y1],
                "worker": &*n.worker,
                "pass": n.pass,
                "error_steps": n.error,
                "rays": n.rays,
                "busy_seconds": n.busy_us as f64 / 1e6,
            })
        })
        .collect();
    Ok(Json(json!({ "first": first, "next": first + tiles.len() as u64, "tiles": tiles })))
}

/// The error of the picture as it was earned.
pub(super) async fn curve(State(site): State<Site>, named: Id) -> Result<Json<Value>, Refusal> {
    let number = id(named)?;
    site.farm.job(number)?;
    let curve = site.farm.canvas(number).map_or_else(Vec::new, |canvas| canvas.curve());
    let (seconds, errors): (Vec<f64>, Vec<f64>) = curve.into_iter().unzip();
    Ok(Json(json!({ "seconds": seconds, "error_steps": errors })))
}

/// What happened, in the farm's words.
pub(super) async fn log(since: Result<Query<Since>, QueryRejection>) -> Result<Json<Value>, Refusal> {
    let Ok(Query(since)) = since else { return Err(refusal(StatusCode::BAD_REQUEST, "since is a number")) };
    Ok(Json(log::since(since.since.unwrap_or(0), PAGE)))
}

pub(super) async fn workers(State(site): State<Site>) -> Json<Value> {
    let workers = site.farm.workers();
    let shown: Vec<Value> = workers.iter().take(PAGE).map(worker_json).collect();
    Json(json!({ "workers": shown, "count": workers.len(), "can_drain": site.farm.can_drain() }))
}

pub(super) async fn drain(State(site): State<Site>, Path(name): Path<String>) -> Response {
    if site.farm.drain(&name).await {
        Json(json!({ "name": name })).into_response()
    } else {
        refusal(StatusCode::NOT_FOUND, "there is no worker of this name").into_response()
    }
}

/// A job as JSON: what the OpenAPI document calls `Job`.
pub(super) fn job_json(farm: &dyn Source, job: &Job) -> Value {
    let spec = job.spec.clone().unwrap_or_default();
    let time = |n: u64| (n > 0).then_some(n);
    let hex = |bytes: &[u8]| bytes.iter().map(|b| format!("{b:02x}")).collect::<String>();
    json!({
        "id": job.id,
        "state": state_name(job.state()),
        "name": spec.name,
        "owner": spec.owner,
        "priority": spec.priority,
        "group": spec.group,
        "region": spec.region.map(|r| [r.x0, r.y0, r.x1, r.y1]),
        "target_steps": (spec.max_error > 0.0).then_some(255.0 * spec.max_error),
        "deadline_ms": time(spec.deadline_ms),
        "submitted_ms": job.submitted_ms,
        "started_ms": time(job.started_ms),
        "ended_ms": time(job.ended_ms),
        "failure": (!job.failure.is_empty()).then_some(&job.failure),
        "same_as": time(job.same_as),
        "actions": farm.actions(job.state()),
        "progress": job.progress.as_ref().map(|p| json!({
            "share": p.share,
            "pass": p.pass,
            "look": p.is_look,
            "tiles_done": p.tiles_done,
            "tiles_total": p.tiles_total,
            "pixels_done": p.pixels_done,
            "pixels_total": p.pixels_total,
            "rays": p.rays.map_or(0, |r| r.camera + r.mirror + r.shadow),
            "elapsed_seconds": p.elapsed_us as f64 / 1e6,
            "remaining_seconds": p.remaining_us.map(|us| us as f64 / 1e6),
            "workers": p.workers,
            "error_steps": p.error.map(|error| 255.0 * error),
        })),
        "result": job.result.as_ref().map(|r| json!({
            "pixels_sha256": hex(&r.pixels_sha256),
            "rays": r.rays.map_or(0, |r| r.camera + r.mirror + r.shadow),
            "target_met": r.target_met,
            "passes": r.passes,
            "tiles": r.tiles,
            "trace_seconds": r.trace_us as f64 / 1e6,
        })),
    })
}

/// A worker as JSON: what the OpenAPI document calls `Worker`.
#[must_use]
pub fn worker_json(w: &Worker) -> Value {
    json!({
        "name": w.name,
        "address": w.address,
        "threads": w.threads,
        "job": (w.job > 0).then_some(w.job),
        "draining": w.draining,
        "tiles": w.tiles,
        "pixels": w.pixels,
        "rays": w.rays,
        "busy_seconds": w.busy_us as f64 / 1e6,
        "lost": w.lost,
        "verified": w.verified,
    })
}
