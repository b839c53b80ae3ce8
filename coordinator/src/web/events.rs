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
use super::{Farm, refusal};

/// Between two events: what happens meanwhile is told together.
const EVERY: Duration = Duration::from_millis(200);

/// Which job is looked at.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Watched {
    job: Option<u64>,
}

pub(super) async fn events(State(farm): State<Farm>, watched: Result<Query<Watched>, QueryRejection>) -> Response {
    let Ok(Query(Watched { job })) = watched else {
        return refusal(StatusCode::BAD_REQUEST, "a job is named by its number").into_response();
    };
    // One that does not read gets the next word when it does: nothing piles up.
    let (out, events) = mpsc::channel::<Result<Event, Infallible>>(1);
    tokio::spawn(async move {
        let changes = farm.queue.changes();
        let mut said = String::new();
        loop {
            let shown = job.and_then(|id| farm.queue.job(id).ok());
            let now = json!({
                "changes": *changes.borrow(),
                "workers": farm.queue.worker_count(),
                "job": shown.as_ref().map(job_json),
                "tiles": job.and_then(|id| farm.queue.canvas(id)).map(|c| c.tiles()),
            })
            .to_string();
            if now != said {
                if out.send(Ok(Event::default().event("state").data(&now))).await.is_err() {
                    return;
                }
                said = now;
            }
            tokio::select! {
                () = tokio::time::sleep(EVERY) => {}
                () = out.closed() => return,
                () = farm.stop.cancelled() => return,
            }
        }
    });
    Sse::new(ReceiverStream::new(events)).keep_alive(KeepAlive::default()).into_response()
}
