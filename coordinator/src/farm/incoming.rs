//! Connections as they come: counted, watched, and made secure where the farm is guarded.

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::time::sleep_until;
use tokio_rustls::TlsAcceptor;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::{CancellationToken, WaitForCancellationFutureOwned};
use tonic::transport::server::Connected;

use super::gate::{Connection, Gate};
use super::liveness::LastSign;
use super::strangers::Strangers;
use crate::access::Guarded;

/// Fewer bytes at a time may be the answer to a ping, which a connection gives by itself: a worker may be dead behind
/// it.
const MORE_THAN_A_PING: usize = 128;
/// Pause after accepting failed.
const AFTER_FAILURE: Duration = Duration::from_millis(200);
/// The first byte of a TLS handshake.
const TLS: u8 = 0x16;

/// Who is at the other end, as far as the connection tells.
#[derive(Clone, Debug)]
pub(super) struct Peer {
    pub(super) address: SocketAddr,
    pub(super) connection: Arc<Connection>,
    pub(super) standing: Standing,
    pub(super) last_sign: LastSign,
}

/// What a connection has shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Standing {
    /// The farm asks for nothing.
    Open,
    /// It came without TLS to a farm that asks for it.
    Plain,
    /// TLS; with a certificate of an authority that the farm takes, or without.
    Secure { certified: bool },
}

/// What connections are held against.
#[derive(Clone, Debug)]
pub(super) struct Admission {
    pub(super) gate: Arc<Gate>,
    pub(super) strangers: Arc<Strangers>,
    pub(super) guard: Option<Arc<Guarded>>,
}

/// Accepts connections until `stop`.
pub(super) fn accept(
    listener: TcpListener,
    admission: Admission,
    stop: CancellationToken,
) -> ReceiverStream<io::Result<Incoming>> {
    let (sender, receiver) = mpsc::channel(16);
    tokio::spawn(async move {
        loop {
            let accepted = tokio::select! {
                () = stop.cancelled() => return,
                accepted = listener.accept() => accepted,
            };
            match accepted {
                Ok((stream, address)) => {
                    let Some(connection) = admission.gate.enter(address.ip()) else { continue };
                    // Small messages must not wait for large ones.
                    let _ = stream.set_nodelay(true);
                    let watched = Watched::new(stream, connection, admission.gate.clone());
                    let (admission, sender) = (admission.clone(), sender.clone());
                    tokio::spawn(async move {
                        if let Some(incoming) = admission.secure(watched, address).await {
                            let _ = sender.send(Ok(incoming)).await;
                        }
                    });
                }
                Err(e) => {
                    tracing::warn!("cannot accept a connection: {e}");
                    tokio::time::sleep(AFTER_FAILURE).await;
                }
            }
        }
    });
    ReceiverStream::new(receiver)
}

impl Admission {
    /// Shakes hands where the farm is guarded. Gives nothing where the connection is of no use.
    async fn secure(&self, watched: Watched, address: SocketAddr) -> Option<Incoming> {
        let (connection, last_sign) = (watched.connection.clone(), watched.last_sign.clone());
        let made = async {
            let Some(guard) = &self.guard else {
                return Some((Box::new(watched) as Box<dyn Stream>, Standing::Open));
            };
            let mut first = [0];
            if watched.stream.peek(&mut first).await.ok()? == 0 {
                return None;
            }
            if first[0] != TLS {
                return Some((Box::new(watched) as Box<dyn Stream>, Standing::Plain));
            }
            sleep_until(self.strangers.turn(address.ip())?).await;
            match TlsAcceptor::from(guard.tls.clone()).accept(watched).await {
                Ok(tls) => {
                    let certified = tls.get_ref().1.peer_certificates().is_some_and(|c| !c.is_empty());
                    Some((Box::new(tls) as Box<dyn Stream>, Standing::Secure { certified }))
                }
                Err(e) => {
                    tracing::debug!("no TLS with {address}: {e}");
                    None
                }
            }
        };
        let (io, standing) = tokio::select! {
            made = made => made?,
            () = connection.cut.cancelled() => return None,
        };
        Some(Incoming { io, peer: Peer { address, connection: connection.clone(), standing, last_sign } })
    }
}

trait Stream: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Stream for T {}

/// A connection to be served.
pub(super) struct Incoming {
    io: Box<dyn Stream>,
    peer: Peer,
}

impl Connected for Incoming {
    type ConnectInfo = Peer;

    fn connect_info(&self) -> Peer {
        self.peer.clone()
    }
}

/// A connection that counts, and that fails when the gate cuts it.
struct Watched {
    stream: TcpStream,
    cut: Pin<Box<WaitForCancellationFutureOwned>>,
    connection: Arc<Connection>,
    gate: Arc<Gate>,
    /// Bytes are signs of life, whatever they belong to: on a slow line a result takes longer than a worker may
    /// be silent.
    last_sign: LastSign,
}

impl Watched {
    fn new(stream: TcpStream, connection: Arc<Connection>, gate: Arc<Gate>) -> Self {
        let cut = Box::pin(connection.cut.clone().cancelled_owned());
        Self { stream, cut, connection, gate, last_sign: LastSign::default() }
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        self.gate.left(&self.connection);
    }
}

impl AsyncRead for Watched {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        if self.cut.as_mut().poll(cx).is_ready() {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        let read = Pin::new(&mut self.stream).poll_read(cx, buf);
        if buf.filled().len() - before >= MORE_THAN_A_PING {
            self.last_sign.beat();
        }
        read
    }
}

impl AsyncWrite for Watched {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, data: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, data)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        data: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(cx, data)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }
}

impl AsyncRead for Incoming {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.io).poll_read(cx, buf)
    }
}

impl AsyncWrite for Incoming {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, data: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.io).poll_write(cx, data)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.io).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.io).poll_shutdown(cx)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        data: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.io).poll_write_vectored(cx, data)
    }

    fn is_write_vectored(&self) -> bool {
        self.io.is_write_vectored()
    }
}
