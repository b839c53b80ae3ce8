//! The farm's page and its interface for machines, over HTTP on this machine.
//!
//! It listens on loopback alone, answers only to names of this machine, and changes nothing for a request that another
//! site had a browser make.

mod api;
mod events;
mod metrics;
mod picture;

use axum::Router;
use axum::extract::Request;
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, ORIGIN, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use crate::queue::Queue;

const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Answers for `queue` on `listener` until `stop`.
///
/// # Errors
/// When the listener fails.
pub async fn serve(listener: TcpListener, queue: Queue, stop: CancellationToken) -> std::io::Result<()> {
    // Streams of events end with the farm; whoever is still connected after that is not waited for.
    let served = axum::serve(listener, router(queue, stop.clone()));
    tokio::select! {
        served = async { served.await } => served,
        () = stop.cancelled() => Ok(()),
    }
}

/// What every handler knows.
#[derive(Clone)]
pub(crate) struct Farm {
    pub(crate) queue: Queue,
    pub(crate) stop: CancellationToken,
    /// Pictures that are made at once.
    pub(crate) pictures: std::sync::Arc<tokio::sync::Semaphore>,
}

fn router(queue: Queue, stop: CancellationToken) -> Router {
    let pictures = std::sync::Arc::new(tokio::sync::Semaphore::new(4));
    Router::new()
        .route("/", get(|| file("text/html; charset=utf-8", include_str!("page/index.html"))))
        .route("/style.css", get(|| file("text/css; charset=utf-8", include_str!("page/style.css"))))
        .route("/app.js", get(|| file("text/javascript; charset=utf-8", include_str!("page/app.js"))))
        .route("/picture.js", get(|| file("text/javascript; charset=utf-8", include_str!("page/picture.js"))))
        .route("/api/v1/openapi.json", get(|| file("application/json", include_str!("openapi.json"))))
        .route("/api/v1/jobs", get(api::jobs))
        .route("/api/v1/jobs/{id}", get(api::job))
        .route("/api/v1/jobs/{id}/pause", post(api::pause))
        .route("/api/v1/jobs/{id}/resume", post(api::resume))
        .route("/api/v1/jobs/{id}/cancel", post(api::cancel))
        .route("/api/v1/jobs/{id}/tiles", get(api::tiles))
        .route("/api/v1/jobs/{id}/picture.png", get(picture::png))
        .route("/api/v1/jobs/{id}/pixel", get(picture::pixel))
        .route("/api/v1/workers", get(api::workers))
        .route("/api/v1/workers/{name}/drain", post(api::drain))
        .route("/api/v1/events", get(events::events))
        .route("/metrics", get(metrics::metrics))
        .route("/healthz", get(|| async { "ok\n" }))
        .route("/readyz", get(|| async { "ok\n" }))
        .layer(from_fn(guard))
        .with_state(Farm { queue, stop, pictures })
}

async fn file(kind: &'static str, text: &'static str) -> Response {
    ([(CONTENT_TYPE, kind)], text).into_response()
}

/// An answer that says why there is none.
#[derive(Debug)]
pub(crate) struct Refusal(StatusCode, String);

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.0, axum::Json(serde_json::json!({ "error": self.1 }))).into_response()
    }
}

pub(crate) fn refusal(status: StatusCode, why: impl std::fmt::Display) -> Refusal {
    Refusal(status, why.to_string())
}

/// Whether a request may be answered: only for this machine, and changes only from pages of its own.
fn may(method: &Method, headers: &HeaderMap) -> Result<(), Refusal> {
    let text = |name: HeaderName| headers.get(name).and_then(|v| v.to_str().ok());
    let host = text(HOST).unwrap_or_default();
    let name =
        host.rsplit_once(':').filter(|(_, port)| port.bytes().all(|b| b.is_ascii_digit())).map_or(host, |(n, _)| n);
    if !["localhost", "127.0.0.1", "[::1]"].contains(&name) {
        return Err(refusal(StatusCode::MISDIRECTED_REQUEST, "this page is for its own machine alone"));
    }
    if [Method::GET, Method::HEAD].contains(method) {
        return Ok(());
    }
    let foreign = text(ORIGIN).is_some_and(|origin| origin != format!("http://{host}"));
    let site = text(HeaderName::from_static("sec-fetch-site")).unwrap_or("none");
    if foreign || !["same-origin", "none"].contains(&site) {
        return Err(refusal(StatusCode::FORBIDDEN, "another site asks for this"));
    }
    Ok(())
}

async fn guard(request: Request, next: Next) -> Response {
    let mut response = match may(request.method(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(refused) => refused.into_response(),
    };
    let fixed = [
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
        (CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ];
    for (name, value) in fixed {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(method: Method, headers: &[(&str, &str)]) -> bool {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.insert(HeaderName::try_from(*name).unwrap(), HeaderValue::try_from(*value).unwrap());
        }
        may(&method, &map).is_ok()
    }

    #[test]
    fn only_this_machine_is_answered_and_no_other_site_changes_anything() {
        assert!(asked(Method::GET, &[("host", "localhost:8080")]) && asked(Method::GET, &[("host", "[::1]:80")]));
        for host in ["evil.example", "127.0.0.1.evil.example:8080", "localhost.evil:1", ""] {
            assert!(!asked(Method::GET, &[("host", host)]), "{host}");
        }
        let host = ("host", "127.0.0.1:8080");
        assert!(asked(Method::POST, &[host]));
        assert!(asked(Method::POST, &[host, ("origin", "http://127.0.0.1:8080"), ("sec-fetch-site", "same-origin")]));
        for (name, value) in [
            ("origin", "http://evil.example"),
            ("origin", "null"),
            ("origin", "http://127.0.0.1:81"),
            ("sec-fetch-site", "cross-site"),
            ("sec-fetch-site", "same-site"),
        ] {
            assert!(!asked(Method::POST, &[host, (name, value)]), "{name}: {value}");
        }
    }
}
