//! What happens, as it happens: server-sent events. Each says how things are, so that who was away misses nothing.

use std::convert::Infallible;
use std::time::Duration;

use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

use super::api::job_json;
use super::{Site, log, refusal};

/// Between two events: what happens meanwhile is told together.
const EVERY: Duration = Duration::from_millis(200);

/// Which job is looked at.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Watched {
    job: Option<u64>,
}

pub(super) async fn events(State(site): State<Site>, watched: Result<Query<Watched>, QueryRejection>) -> Response {
    let Ok(Query(Watched { job })) = watched else {
        return refusal(StatusCode::BAD_REQUEST, "a job is named by its number").into_response();
    };
    // One that does not read gets the next word when it does: nothing piles up.
    let (out, events) = mpsc::channel::<Result<Event, Infallible>>(1);
    tokio::spawn(async move {
        let mut said = String::new();
        let mut last = false;
        loop {
            let shown = job.and_then(|id| site.farm.job(id).ok());
            let now = json!({
                "changes": site.farm.changes(),
                "workers": site.farm.worker_count(),
                "job": shown.as_ref().map(|job| job_json(&*site.farm, job)),
                "log": log::next(),
                "tiles": job.and_then(|id| site.farm.canvas(id)).map(|c| c.tiles()),
            })
            .to_string();
            if now != said {
                if out.send(Ok(Event::default().event("state").data(&now))).await.is_err() {
                    return;
                }
                said = now;
            }
            if last {
                return;
            }
            tokio::select! {
                () = tokio::time::sleep(EVERY) => {}
                () = out.closed() => return,
                () = site.stop.cancelled() => last = true,
            }
        }
    });
    Sse::new(ReceiverStream::new(events)).keep_alive(KeepAlive::default()).into_response()
}
