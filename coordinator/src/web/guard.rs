//! What every request passes first: who may ask, and that no other site has a browser ask.

use axum::extract::{Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, HOST, ORIGIN, REFERRER_POLICY, WWW_AUTHENTICATE, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::listen::Peer;
use super::login::{self, Shown};
use super::{Refusal, Site, refusal};

const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// What every request that changes something carries: no form can send it, and no script of another site may.
const PROOF: HeaderName = HeaderName::from_static("x-tessera");
/// What is answered before one is logged in.
const FREE: [&str; 5] = ["/login", "/login.js", "/login.css", "/healthz", "/readyz"];

fn text(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name).and_then(|v| v.to_str().ok())
}

/// Without a lock, only this machine is answered, by its own names: another site's name may lead here.
fn is_own_host(headers: &HeaderMap) -> bool {
    let host = text(headers, HOST).unwrap_or_default();
    let name =
        host.rsplit_once(':').filter(|(_, port)| port.bytes().all(|b| b.is_ascii_digit())).map_or(host, |(n, _)| n);
    ["localhost", "127.0.0.1", "[::1]"].contains(&name)
}

/// Whether nothing says that another site has a browser make this request, and it could not have if it is one that
/// changes something.
fn is_own_request(method: &Method, headers: &HeaderMap, scheme: &str, by_token: bool) -> Result<(), Refusal> {
    if [Method::GET, Method::HEAD].contains(method) {
        return Ok(());
    }
    let host = text(headers, HOST).unwrap_or_default();
    let foreign = headers.contains_key(ORIGIN) && text(headers, ORIGIN) != Some(&format!("{scheme}://{host}"));
    let site = text(headers, HeaderName::from_static("sec-fetch-site")).unwrap_or("none");
    if foreign || !["same-origin", "none"].contains(&site) {
        return Err(refusal(StatusCode::FORBIDDEN, "another site asks for this"));
    }
    if !by_token && !headers.contains_key(PROOF) {
        return Err(refusal(StatusCode::FORBIDDEN, "what changes something needs the header 'X-Tessera: 1'"));
    }
    Ok(())
}

/// Whether a request may be answered.
async fn may(
    site: &Site,
    (method, path): (&Method, &str),
    headers: &HeaderMap,
    peer: Option<Peer>,
) -> Result<(), Refusal> {
    let Some(lock) = &site.lock else {
        if !is_own_host(headers) {
            return Err(refusal(StatusCode::MISDIRECTED_REQUEST, "this page is for its own machine alone"));
        }
        return is_own_request(method, headers, "http", false);
    };
    let Some(Peer(address)) = peer else {
        return Err(refusal(StatusCode::INTERNAL_SERVER_ERROR, "a request from nowhere"));
    };
    if FREE.contains(&path) {
        return is_own_request(method, headers, "https", false);
    }
    let shown = lock.who(headers, address).await?;
    is_own_request(method, headers, "https", shown == Shown::Token)?;
    match shown {
        Shown::Token | Shown::Cookie => Ok(()),
        Shown::Nothing => {
            Err(refusal(StatusCode::UNAUTHORIZED, "log in at /login, or send the users' token as Bearer"))
        }
    }
}

/// Lets through what may be answered, and says to browsers how to treat the answer.
pub(super) async fn guard(State(site): State<Site>, request: Request, next: Next) -> Response {
    let wants_page = request.uri().path() == "/" && request.method() == Method::GET;
    // A request's body may not be looked at by two at once, so that it stays out of what waits.
    let peer = request.extensions().get().copied();
    let (method, path, headers) = (request.method(), request.uri().path(), request.headers());
    let mut response = match may(&site, (method, path), headers, peer).await {
        Ok(()) => next.run(request).await,
        // Whoever opens the page is shown where to log in.
        Err(Refusal(StatusCode::UNAUTHORIZED, _)) if wants_page => login::page(StatusCode::UNAUTHORIZED),
        Err(refused) => refused.into_response(),
    };
    if response.status() == StatusCode::UNAUTHORIZED {
        response.headers_mut().insert(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
    }
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

    fn map(headers: &[(&str, &str)]) -> HeaderMap {
        let pair = |(name, value): &(&str, &str)| {
            (HeaderName::try_from(*name).unwrap(), HeaderValue::try_from(*value).unwrap())
        };
        headers.iter().map(pair).collect()
    }

    #[test]
    fn an_open_page_answers_to_names_of_this_machine_alone() {
        for host in ["localhost:8080", "[::1]:80", "127.0.0.1"] {
            assert!(is_own_host(&map(&[("host", host)])), "{host}");
        }
        for host in ["evil.example", "127.0.0.1.evil.example:8080", "localhost.evil:1", ""] {
            assert!(!is_own_host(&map(&[("host", host)])), "{host}");
        }
    }

    #[test]
    fn no_other_site_changes_anything() {
        let asked = |method, headers: &[(&str, &str)], by_token| {
            is_own_request(&method, &map(headers), "https", by_token).is_ok()
        };
        let (host, proof) = (("host", "farm:8080"), ("x-tessera", "1"));
        assert!(asked(Method::GET, &[host], false));
        assert!(asked(Method::POST, &[host, proof], false));
        assert!(asked(Method::POST, &[host], true));
        let own = [host, proof, ("origin", "https://farm:8080"), ("sec-fetch-site", "same-origin")];
        assert!(asked(Method::POST, &own, false));
        assert!(!asked(Method::POST, &[host], false), "a form can send that");
        for (name, value) in [
            ("origin", "https://evil.example"),
            ("origin", "null"),
            ("origin", "\u{ff}"),
            ("origin", "http://farm:8080"),
            ("origin", "https://farm:81"),
            ("sec-fetch-site", "cross-site"),
            ("sec-fetch-site", "same-site"),
        ] {
            assert!(!asked(Method::POST, &[host, proof, (name, value)], true), "{name}: {value}");
        }
    }
}
