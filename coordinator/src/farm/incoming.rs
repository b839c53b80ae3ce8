//! Connections: how many, and how long they may stay silent.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio::time::Sleep;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::transport::server::{Connected, TcpConnectInfo};

use super::pulse::Pulse;

/// Connections at once, at most: below the usual limit of open files, which would make
/// accepting fail in a busy loop.
const CONNECTIONS: usize = 900;
/// How long a connection may take to say its first byte.
const SPEAK_WITHIN: Duration = Duration::from_secs(5);
/// Fewer bytes at a time may be the answer to a ping, which a connection gives by itself: a worker may be dead behind
/// it.
const MORE_THAN_A_PING: usize = 128;
/// Pause after accepting failed.
const AFTER_FAILURE: Duration = Duration::from_millis(200);

/// Accepts connections until `stop`.
pub(super) fn accept(listener: TcpListener, stop: CancellationToken) -> ReceiverStream<io::Result<Guarded>> {
    let (sender, receiver) = mpsc::channel(16);
    tokio::spawn(async move {
        let room = Arc::new(Semaphore::new(CONNECTIONS));
        loop {
            let accepted = tokio::select! {
                () = stop.cancelled() => return,
                accepted = async {
                    let permit = room.clone().acquire_owned().await.ok()?;
                    Some(listener.accept().await.map(|(stream, _)| (stream, permit)))
                } => accepted,
            };
            match accepted {
                Some(Ok((stream, permit))) => {
                    // Small messages must not wait for large ones.
                    let _ = stream.set_nodelay(true);
                    let silence = Some(Box::pin(tokio::time::sleep(SPEAK_WITHIN)));
                    let pulse = Pulse::default();
                    if sender.send(Ok(Guarded { stream, silence, pulse, _permit: permit })).await.is_err() {
                        return;
                    }
                }
                Some(Err(e)) => {
                    tracing::warn!("cannot accept a connection: {e}");
                    tokio::time::sleep(AFTER_FAILURE).await;
                }
                None => return,
            }
        }
    });
    ReceiverStream::new(receiver)
}

/// A connection that counts, and that fails if its first byte does not come in time.
pub(super) struct Guarded {
    stream: TcpStream,
    silence: Option<Pin<Box<Sleep>>>,
    /// Bytes are signs of life, whatever they belong to: on a slow line a result takes longer than a worker may
    /// be silent.
    pulse: Pulse,
    _permit: OwnedSemaphorePermit,
}

/// Whose connection a request came over.
#[derive(Clone, Debug)]
pub(super) struct Peer {
    pub(super) tcp: TcpConnectInfo,
    pub(super) pulse: Pulse,
}

impl Connected for Guarded {
    type ConnectInfo = Peer;

    fn connect_info(&self) -> Peer {
        Peer { tcp: self.stream.connect_info(), pulse: self.pulse.clone() }
    }
}

impl AsyncRead for Guarded {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(cx, buf);
        if read.is_ready() {
            self.silence = None;
            if buf.filled().len() - before >= MORE_THAN_A_PING {
                self.pulse.beat();
            }
        } else if let Some(silence) = &mut self.silence
            && silence.as_mut().poll(cx).is_ready()
        {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        read
    }
}

impl AsyncWrite for Guarded {
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
