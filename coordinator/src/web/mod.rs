//! The page of a farm or of a single render, and its interface for machines, over HTTP.
//!
//! On loopback it asks for nothing and answers to names of this machine alone. Beyond, it speaks TLS and asks for the
//! users' token. Either way nothing is changed for a request that another site had a browser make.

mod api;
mod events;
mod guard;
mod listen;
pub mod log;
mod login;
mod metrics;
mod picture;
mod single;
mod source;

use std::net::SocketAddr;
use std::sync::Arc;

use axum::Router;
use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use crate::access::{Access, AccessError};
use crate::farm::Strangers;
use crate::queue::Queue;
pub use api::worker_json;
use login::Lock;
pub use single::Single;
use source::Source;

/// Pictures that are made at once.
const PICTURES: usize = 4;

/// A page that listens, so that a busy address is known before anything else is done.
#[derive(Debug)]
pub struct Page {
    listener: TcpListener,
    addr: SocketAddr,
    lock: Option<Arc<Lock>>,
    certificate: Option<String>,
    strangers: Arc<Strangers>,
}

impl Page {
    /// Listens, and asks for nothing: for loopback. `strangers` are those of the farm.
    ///
    /// # Errors
    /// When the address is taken or not of this machine.
    pub async fn bind(addr: SocketAddr, strangers: Arc<Strangers>) -> std::io::Result<Self> {
        let listener = TcpListener::bind(addr).await?;
        let addr = listener.local_addr()?;
        Ok(Self { listener, addr, lock: None, certificate: None, strangers })
    }

    /// Asks for TLS and the users' token from now on; whoever shows a wrong one is a stranger. Browsers call this machine
    /// by `names`.
    ///
    /// # Errors
    /// When `access` asks for nothing or has no users, or a name cannot stand in a certificate.
    pub fn guarded(self, access: Access, names: Vec<String>) -> Result<Self, AccessError> {
        if access.user_token().is_none() {
            return Err(AccessError::Tls("there is no users' token".into()));
        }
        let (tls, pin) = access.page_tls(names)?;
        let certificate = pin.0.map(|b| format!("{b:02X}")).join(":");
        let lock = Some(Arc::new(Lock::new(tls, self.strangers.clone(), access)));
        Ok(Self { lock, certificate: Some(certificate), ..self })
    }

    /// Where it listens.
    #[must_use]
    pub fn addr(&self) -> SocketAddr {
        self.addr
    }

    /// SHA-256 over the certificate that browsers see, as they show it; `None` where there is no TLS.
    #[must_use]
    pub fn certificate(&self) -> Option<&str> {
        self.certificate.as_deref()
    }

    /// Shows the jobs of `queue` until `stop`.
    pub async fn show(self, queue: Queue, stop: CancellationToken) {
        self.serve(Arc::new(queue), stop).await;
    }

    /// Shows a single render until `stop`.
    pub async fn show_single(self, single: Single, stop: CancellationToken) {
        self.serve(Arc::new(single), stop).await;
    }

    async fn serve(self, source: Arc<dyn Source>, stop: CancellationToken) {
        let pictures = Arc::new(Semaphore::new(PICTURES));
        let strangers = self.strangers;
        let site = Site { farm: source, stop: stop.clone(), pictures, lock: self.lock.clone(), strangers };
        listen::serve(self.listener, router(site), self.lock, stop).await;
    }
}

/// What every handler knows.
#[derive(Clone)]
pub(crate) struct Site {
    pub(crate) farm: Arc<dyn Source>,
    pub(crate) stop: CancellationToken,
    /// Pictures that are made at once.
    pub(crate) pictures: Arc<Semaphore>,
    /// `None` on loopback.
    lock: Option<Arc<Lock>>,
    strangers: Arc<Strangers>,
}

fn router(site: Site) -> Router {
    let (html, css, js) = ("text/html; charset=utf-8", "text/css; charset=utf-8", "text/javascript; charset=utf-8");
    Router::new()
        .route("/", get(move || file(html, include_str!("page/index.html"))))
        .route("/style.css", get(move || file(css, include_str!("page/style.css"))))
        .route("/app.js", get(move || file(js, include_str!("page/app.js"))))
        .route("/curve.js", get(move || file(js, include_str!("page/curve.js"))))
        .route("/picture.js", get(move || file(js, include_str!("page/picture.js"))))
        .route("/login", get(login::form).post(login::login))
        .route("/login.css", get(move || file(css, include_str!("page/style.css"))))
        .route("/login.js", get(move || file(js, include_str!("page/login.js"))))
        .route("/logout", post(login::logout))
        .route("/api/v1/openapi.json", get(|| file("application/json", include_str!("openapi.json"))))
        .route("/api/v1/jobs", get(api::jobs))
        .route("/api/v1/jobs/{id}", get(api::job))
        .route("/api/v1/jobs/{id}/pause", post(api::pause))
        .route("/api/v1/jobs/{id}/resume", post(api::resume))
        .route("/api/v1/jobs/{id}/cancel", post(api::cancel))
        .route("/api/v1/jobs/{id}/tiles", get(api::tiles))
        .route("/api/v1/jobs/{id}/curve", get(api::curve))
        .route("/api/v1/jobs/{id}/picture.png", get(picture::png))
        .route("/api/v1/jobs/{id}/pixel", get(picture::pixel))
        .route("/api/v1/workers", get(api::workers))
        .route("/api/v1/workers/{name}/drain", post(api::drain))
        .route("/api/v1/log", get(api::log))
        .route("/api/v1/events", get(events::events))
        .route("/metrics", get(metrics::metrics))
        .route("/healthz", get(|| async { "ok\n" }))
        .route("/readyz", get(ready))
        .layer(from_fn_with_state(site.clone(), guard::guard))
        .with_state(site)
}

async fn file(kind: &'static str, text: &'static str) -> Response {
    ([(CONTENT_TYPE, kind)], text).into_response()
}

/// Whether jobs are taken and rendered.
async fn ready(State(site): State<Site>) -> Response {
    match site.farm.ready() {
        Ok(()) => "ok\n".into_response(),
        Err(why) => (StatusCode::SERVICE_UNAVAILABLE, format!("{why}\n")).into_response(),
    }
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
