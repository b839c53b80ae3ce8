//! The page's connections: counted, made secure where it is guarded, and none for ever without asking for anything.

use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::{sleep, sleep_until, timeout};
use tokio_rustls::TlsAcceptor;
use tokio_util::sync::CancellationToken;
use tower::Service;

use super::login::Lock;
use crate::farm::prefix;
use crate::open_files::limit as open_files;

/// Connections at once, at most; fewer where few files may be open.
const CONNECTIONS: usize = 1024;
/// Of those, the share that one address may have.
const OF_ONE: usize = 4;
/// How long a handshake, and the head of a request, may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// Bytes of a request's head.
const HEAD: usize = 16 << 10;
/// Pause after accepting failed.
const AFTER_FAILURE: Duration = Duration::from_millis(200);
/// How long those who watch may take to hear the last word.
const LAST_WORD: Duration = Duration::from_millis(300);
/// The first byte of a TLS handshake.
const TLS: u8 = 0x16;
/// What a browser hears that does not speak TLS where it is asked for.
const PLAIN: &[u8] = b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\nThis page is at https:// alone.\n";

/// Where a request comes from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peer(pub(super) IpAddr);

/// Connections by the addresses that they come from.
#[derive(Debug, Default)]
struct Crowd(Mutex<HashMap<IpAddr, usize>>);

/// One of the crowd.
struct Member(Arc<Crowd>, IpAddr);

impl Crowd {
    /// One more; `None` where there are too many.
    fn enter(self: &Arc<Self>, address: IpAddr, most: usize) -> Option<Member> {
        let address = prefix(address);
        let mut by = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // This machine's own share nothing with strangers.
        let share = if address.is_loopback() { most } else { most / OF_ONE };
        if by.values().sum::<usize>() >= most || by.get(&address).is_some_and(|&n| n >= share) {
            return None;
        }
        *by.entry(address).or_default() += 1;
        Some(Member(self.clone(), address))
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        let mut by = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = by.get_mut(&self.1) {
            *count -= 1;
            if *count == 0 {
                by.remove(&self.1);
            }
        }
    }
}

/// Answers by `router` until `stop`; `lock`: who comes must shake hands first.
pub(super) async fn serve(listener: TcpListener, router: Router, lock: Option<Arc<Lock>>, stop: CancellationToken) {
    let (crowd, most) = (Arc::new(Crowd::default()), CONNECTIONS.min(open_files() / 8).max(OF_ONE));
    let mut connections = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            () = stop.cancelled() => break,
            accepted = listener.accept() => accepted,
            Some(_) = connections.join_next() => continue,
        };
        match accepted {
            Ok((stream, address)) => {
                let Some(member) = crowd.enter(address.ip(), most) else { continue };
                let _ = stream.set_nodelay(true);
                let (router, lock, stop) = (router.clone(), lock.clone(), stop.clone());
                connections.spawn(async move {
                    let _member = member;
                    match lock {
                        None => answer(stream, address, router, stop).await,
                        Some(lock) => secure(stream, address, router, &lock, stop).await,
                    }
                });
            }
            Err(e) => {
                tracing::warn!("cannot accept a connection to the page: {e}");
                sleep(AFTER_FAILURE).await;
            }
        }
    }
    // Whoever is still connected after that is not waited for.
    let _ = timeout(LAST_WORD, async { while connections.join_next().await.is_some() {} }).await;
}

/// Shakes hands, then answers.
async fn secure(mut stream: TcpStream, address: SocketAddr, router: Router, lock: &Lock, stop: CancellationToken) {
    let shaken = timeout(PATIENCE, async {
        let mut first = [0];
        if stream.peek(&mut first).await.ok()? == 0 {
            return None;
        }
        if first[0] != TLS {
            let _ = stream.write_all(PLAIN).await;
            let _ = stream.shutdown().await;
            return None;
        }
        sleep_until(lock.strangers.turn(address.ip())?).await;
        TlsAcceptor::from(lock.tls.clone()).accept(stream).await.ok()
    });
    if let Ok(Some(stream)) = shaken.await {
        answer(stream, address, router, stop).await;
    }
}

/// Answers one connection until it ends, or until `stop`, and then what it has begun to ask.
async fn answer<S>(stream: S, address: SocketAddr, router: Router, stop: CancellationToken)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let service = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(Peer(address.ip()));
        router.clone().call(request)
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(PATIENCE)
        .max_buf_size(HEAD)
        .serve_connection(TokioIo::new(stream), service);
    let mut connection = std::pin::pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => ended,
        () = stop.cancelled() => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(e) = ended {
        tracing::debug!("a connection to the page: {e}");
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    #[test]
    fn one_address_leaves_room_for_others() {
        let crowd = Arc::new(Crowd::default());
        let address = |n| Ipv4Addr::new(10, 0, 0, n).into();
        let greedy: Vec<_> = (0..100).filter_map(|_| crowd.enter(address(1), 40)).collect();
        assert_eq!(greedy.len(), 10);
        assert!(crowd.enter(address(2), 40).is_some());
        drop(greedy);
        assert!(crowd.enter(address(1), 40).is_some());
        assert!(crowd.0.lock().unwrap().is_empty());
    }
}
