//! Logging in to a page that others than this machine can reach: by the users' token, for a cookie that scripts cannot
//! read, or call by call.

use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::to_bytes;
use axum::extract::{Request, State};
use axum::http::header::{AUTHORIZATION, CACHE_CONTROL, CONTENT_TYPE, COOKIE, LOCATION, SET_COOKIE};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use tessera_proto::token::{NoRandomness, Secret, Token};
use tokio::time::timeout;
use tokio_rustls::rustls::ServerConfig;

use super::listen::Peer;
use super::{Refusal, Site, refusal};
use crate::access::Access;
use crate::farm::Strangers;

/// The session's cookie: by this name, browsers take it over TLS and for this host alone.
const COOKIE_NAME: &str = "__Host-tessera";
/// How long one is logged in.
const SESSION: Duration = Duration::from_secs(12 * 3600);
/// Sessions at once: the oldest ends where one more begins.
const SESSIONS: usize = 256;
/// Bytes of a token as it is typed, at most, and how long they may take.
const TOKEN: usize = 512;
const TOKEN_WITHIN: Duration = Duration::from_secs(5);

/// What stands before a page that others can reach.
#[derive(Debug)]
pub(super) struct Lock {
    pub(super) tls: Arc<ServerConfig>,
    pub(super) strangers: Arc<Strangers>,
    access: Access,
    sessions: Sessions,
}

/// How a request shows who makes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shown {
    /// By the token itself, which no other site's page can have a browser send.
    Token,
    /// By a session's cookie.
    Cookie,
    Nothing,
}

impl Lock {
    pub(super) fn new(tls: Arc<ServerConfig>, strangers: Arc<Strangers>, access: Access) -> Self {
        Self { tls, strangers, access, sessions: Sessions::default() }
    }

    /// Who makes a request, which came from `address`. A wrong token is answered late.
    pub(super) async fn who(&self, headers: &HeaderMap, address: IpAddr) -> Result<Shown, Refusal> {
        let Some(user) = self.access.user_token() else { return Ok(Shown::Nothing) };
        if let Some(authorization) = headers.get(AUTHORIZATION) {
            let text = authorization.to_str().ok().and_then(|v| v.strip_prefix("Bearer "));
            if text.is_some_and(|text| is_token(text, &user)) {
                return Ok(Shown::Token);
            }
            return Err(self.wrong(address).await);
        }
        let in_session = session(headers).is_some_and(|s| self.sessions.holds(&s, &user.secret, Instant::now()));
        Ok(if in_session { Shown::Cookie } else { Shown::Nothing })
    }

    async fn wrong(&self, address: IpAddr) -> Refusal {
        tokio::time::sleep(self.strangers.failed(address)).await;
        refusal(StatusCode::UNAUTHORIZED, "this is not the users' token: 'coordinator token show --user' prints it")
    }
}

/// Whether a text is the users' token, or the secret in it, as it is called by gRPC.
fn is_token(text: &str, user: &Token) -> bool {
    let secret = text.parse::<Token>().ok().filter(|t| t.pin == user.pin).map(|t| t.secret);
    secret.or_else(|| Secret::parse(text)).is_some_and(|s| s == user.secret)
}

/// The session that a request names.
fn session(headers: &HeaderMap) -> Option<Secret> {
    let all = headers.get_all(COOKIE).iter().filter_map(|v| v.to_str().ok()).flat_map(|v| v.split(';'));
    let mut named = all.filter_map(|pair| pair.trim().split_once('=').filter(|(name, _)| *name == COOKIE_NAME));
    Secret::parse(named.next()?.1)
}

/// Who is logged in.
#[derive(Debug, Default)]
struct Sessions(Mutex<Vec<Session>>);

#[derive(Debug)]
struct Session {
    secret: Secret,
    /// The users' secret that it began with: when that is renewed, the session is over.
    user: Secret,
    until: Instant,
}

impl Sessions {
    fn begin(&self, user: Secret, now: Instant) -> Result<Secret, NoRandomness> {
        let secret = Secret::new()?;
        let mut sessions = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        sessions.retain(|s| s.until > now && s.user == user);
        if sessions.len() >= SESSIONS {
            sessions.remove(0);
        }
        sessions.push(Session { secret, user, until: now + SESSION });
        Ok(secret)
    }

    fn holds(&self, secret: &Secret, user: &Secret, now: Instant) -> bool {
        let sessions = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // All of them, so that the time it takes tells nothing.
        sessions.iter().fold(false, |held, s| held | (s.secret == *secret && s.user == *user && s.until > now))
    }

    fn end(&self, secret: &Secret) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).retain(|s| s.secret != *secret);
    }
}

fn cookie(value: &str, seconds: u64) -> Result<HeaderValue, Refusal> {
    let text = format!("{COOKIE_NAME}={value}; Path=/; Max-Age={seconds}; Secure; HttpOnly; SameSite=Strict");
    HeaderValue::try_from(text).map_err(|e| refusal(StatusCode::INTERNAL_SERVER_ERROR, e))
}

/// Takes the users' token, which is all of the body, and begins a session.
pub(super) async fn login(State(site): State<Site>, request: Request) -> Result<Response, Refusal> {
    let lock = site.lock.as_ref().ok_or_else(|| refusal(StatusCode::NOT_FOUND, "nothing is asked for here"))?;
    let user = lock.access.user_token().ok_or_else(|| refusal(StatusCode::NOT_FOUND, "there are no users"))?;
    let Some(&Peer(address)) = request.extensions().get() else {
        return Err(refusal(StatusCode::INTERNAL_SERVER_ERROR, "a request from nowhere"));
    };
    let body = timeout(TOKEN_WITHIN, to_bytes(request.into_body(), TOKEN)).await;
    let body = body.map_err(|_| refusal(StatusCode::REQUEST_TIMEOUT, "the token does not come"))?;
    let body = body.map_err(|_| refusal(StatusCode::BAD_REQUEST, "a token is all that is to be sent"))?;
    if !std::str::from_utf8(&body).is_ok_and(|text| is_token(text.trim(), &user)) {
        return Err(lock.wrong(address).await);
    }
    let begun = lock.sessions.begin(user.secret, Instant::now());
    let secret = begun.map_err(|e| refusal(StatusCode::INTERNAL_SERVER_ERROR, e))?;
    let cookie = cookie(&secret.reveal(), SESSION.as_secs())?;
    Ok((StatusCode::NO_CONTENT, [(SET_COOKIE, cookie)]).into_response())
}

/// Ends the session.
pub(super) async fn logout(State(site): State<Site>, headers: HeaderMap) -> Result<Response, Refusal> {
    if let (Some(lock), Some(secret)) = (&site.lock, session(&headers)) {
        lock.sessions.end(&secret);
    }
    Ok((StatusCode::NO_CONTENT, [(SET_COOKIE, cookie("", 0)?)]).into_response())
}

/// Where to type the token.
pub(super) async fn form(State(site): State<Site>) -> Response {
    if site.lock.is_none() {
        return (StatusCode::SEE_OTHER, [(LOCATION, "/")]).into_response();
    }
    page(StatusCode::OK)
}

/// The page where to type the token, as the answer to whatever was asked for.
pub(super) fn page(status: StatusCode) -> Response {
    let head = [(CONTENT_TYPE, "text/html; charset=utf-8"), (CACHE_CONTROL, "no-store")];
    (status, head, include_str!("page/login.html")).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_are_few_and_end_by_themselves_and_with_the_token() {
        let (sessions, now) = (Sessions::default(), Instant::now());
        let (user, other) = (Secret::new().unwrap(), Secret::new().unwrap());
        let first = sessions.begin(user, now).unwrap();
        assert!(sessions.holds(&first, &user, now + SESSION / 2));
        assert!(!sessions.holds(&first, &user, now + SESSION));
        assert!(!sessions.holds(&first, &other, now), "the token was renewed");
        assert!(!sessions.holds(&Secret::new().unwrap(), &user, now));
        let second = sessions.begin(user, now).unwrap();
        sessions.end(&second);
        assert!(sessions.holds(&first, &user, now) && !sessions.holds(&second, &user, now));
        for _ in 0..SESSIONS {
            sessions.begin(user, now).unwrap();
        }
        assert!(!sessions.holds(&first, &user, now), "the oldest made room");
        assert_eq!(sessions.0.lock().unwrap().len(), SESSIONS);
    }

    #[test]
    fn the_session_is_found_among_other_cookies() {
        let secret = Secret::new().unwrap();
        let mut headers = HeaderMap::new();
        assert_eq!(session(&headers), None);
        headers.insert(COOKIE, HeaderValue::try_from(format!("a=b; {COOKIE_NAME}={}", secret.reveal())).unwrap());
        assert_eq!(session(&headers), Some(secret));
    }
}
