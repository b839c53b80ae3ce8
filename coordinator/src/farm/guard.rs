//! What every call passes before anything else sees it: the secret, and limits of what it may bring.

use std::convert::Infallible;
use std::future::Future;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};

use http::{HeaderMap, Request, Response, header::AUTHORIZATION};
use http_body_util::{BodyExt, Full, Limited};
use tessera_proto::limits::{MAX_REQUEST_BYTES, REGISTER_WITHIN};
use tessera_proto::token::{REFUSED_KEY, Secret};
use tokio::time::timeout;
use tonic::Status;
use tonic::body::Body;
use tonic::metadata::MetadataValue;
use tower::{Layer, Service};

use super::incoming::{Peer, Standing};
use super::strangers::Strangers;
use crate::access::Guarded;

/// The calls whose request does not end at once.
const LONG: [&str; 2] = ["/tessera.farm.v1.Farm/Work", "/tessera.control.v1.Control/PutScene"];
/// What everybody may ask, and learns nothing by: whether the farm serves.
const HEALTH: &str = "/grpc.health.v1.Health/Check";
/// How the calls of users begin.
const USERS: &str = "/tessera.control.v1.";

/// A refusal that another attempt would not change.
pub(super) fn for_good(mut status: Status) -> Status {
    status.metadata_mut().insert(REFUSED_KEY, MetadataValue::from_static("1"));
    status
}

/// Puts a [`Guard`] before services.
#[derive(Clone, Debug)]
pub(super) struct GuardLayer {
    pub(super) strangers: Arc<Strangers>,
    pub(super) guard: Option<Arc<Guarded>>,
    /// What workers of this process show.
    pub(super) local: Secret,
}

impl<S> Layer<S> for GuardLayer {
    type Service = Guard<S>;

    fn layer(&self, behind: S) -> Guard<S> {
        Guard { layer: self.clone(), behind }
    }
}

/// See the [module](self).
#[derive(Clone, Debug)]
pub(super) struct Guard<S> {
    layer: GuardLayer,
    behind: S,
}

impl GuardLayer {
    /// Whether whoever calls may; else what to answer.
    fn admit(&self, peer: Option<&Peer>, headers: &HeaderMap, of_users: bool) -> Result<(), Status> {
        let refused = |why: &str| Err(for_good(Status::unauthenticated(why)));
        let Some(guard) = &self.guard else { return Ok(()) };
        let Some(&Peer { standing: Standing::Secure { certified }, ref connection, .. }) = peer else {
            return refused(match of_users {
                true => "TLS and the users' token are asked for here: --token-file, or TESSERA_TOKEN",
                false => "TLS and a token are asked for here: worker --token, or --token-file, or TESSERA_TOKEN",
            });
        };
        // Also after a renewal: whoever is in stays in.
        let known = if of_users { &connection.known_user } else { &connection.known };
        if known.load(Ordering::Acquire) {
            return Ok(());
        }
        let shown = headers.get(AUTHORIZATION).and_then(|v| Secret::parse(v.to_str().ok()?.strip_prefix("Bearer ")?));
        if of_users {
            if shown.is_some_and(|s| guard.admits_user(&s)) {
                known.store(true, Ordering::Release);
                return Ok(());
            }
            return refused("this needs the users' token: 'coordinator token show --user' prints it where the farm is");
        }
        let local = shown.is_some_and(|s| s == self.local);
        if local || if guard.wants_certificates() { certified } else { shown.is_some_and(|s| guard.admits(&s)) } {
            known.store(true, Ordering::Release);
            return Ok(());
        }
        match shown {
            _ if guard.wants_certificates() => {
                refused("a certificate is asked for here: worker --tls-cert FILE --tls-key FILE")
            }
            None => refused("a token is asked for here: worker --token, or --token-file, or TESSERA_TOKEN"),
            Some(_) => refused("the token is not this farm's, or not any more: 'coordinator token show' prints it"),
        }
    }
}

impl<S> Service<Request<Body>> for Guard<S>
where
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible> + Clone + Send + 'static,
    S::Future: Send,
{
    type Response = Response<Body>;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Body>, Infallible>> + Send>>;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        self.behind.poll_ready(cx)
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let peer = request.extensions().get::<Peer>();
        let path = request.uri().path();
        let admitted = match path {
            HEALTH => Ok(()),
            _ => self.layer.admit(peer, request.headers(), path.starts_with(USERS)),
        };
        if let Err(status) = admitted {
            let address = peer.map_or(IpAddr::from([0; 4]), |p| p.address.ip());
            let wait = self.layer.strangers.failed(address);
            // What it brought is let go of before it waits.
            drop(request);
            return Box::pin(async move {
                tokio::time::sleep(wait).await;
                Ok(status.into_http())
            });
        }
        // The one that is ready; its clone need not be.
        let ready = self.behind.clone();
        let mut behind = std::mem::replace(&mut self.behind, ready);
        if LONG.contains(&request.uri().path()) {
            return Box::pin(behind.call(request));
        }
        Box::pin(async move {
            match whole(request).await {
                Ok(request) => behind.call(request).await,
                Err(status) => Ok(status.into_http()),
            }
        })
    }
}

/// The request with all of its body, which is short and comes soon.
async fn whole(request: Request<Body>) -> Result<Request<Body>, Status> {
    let (head, body) = request.into_parts();
    let body = timeout(REGISTER_WITHIN, Limited::new(body, MAX_REQUEST_BYTES).collect())
        .await
        .map_err(|_| Status::deadline_exceeded("the request does not end"))?
        .map_err(|_| Status::resource_exhausted("the request is too long, or broke off"))?;
    Ok(Request::from_parts(head, Body::new(Full::new(body.to_bytes()))))
}
