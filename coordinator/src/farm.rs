//! A render from listening to the finished picture.

use std::net::SocketAddr;

use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use crate::job::{ListenAddr, Progress, RenderError, RenderJob, Rendered, Unfinished};

/// A farm that listens, so that a busy port is known before anything is read or traced.
#[derive(Debug)]
pub struct Farm {
    listener: TcpListener,
    addr: SocketAddr,
}

impl Farm {
    /// Listens for workers. They can connect from now on; they are answered once [`Farm::render`] runs.
    ///
    /// # Errors
    /// [`RenderError::Listen`] when the address is taken or not of this machine.
    pub async fn bind(listen: ListenAddr) -> Result<Self, RenderError> {
        let wanted = match listen {
            ListenAddr::Loopback => SocketAddr::from(([127, 0, 0, 1], 0)),
            ListenAddr::Socket(addr) => addr,
        };
        let failed = |source| RenderError::Listen { addr: wanted, source };
        let listener = TcpListener::bind(wanted).await.map_err(failed)?;
        let addr = listener.local_addr().map_err(failed)?;
        Ok(Self { listener, addr })
    }

    /// The address workers connect to, with its actual port.
    #[must_use]
    pub fn addr(&self) -> SocketAddr {
        self.addr
    }

    /// Renders `job`, keeping `progress` up to date, until done, failed or cancelled.
    ///
    /// # Errors
    /// [`Unfinished`], with everything that was done until then.
    pub async fn render(
        self,
        job: RenderJob,
        progress: watch::Sender<Progress>,
        cancel: CancellationToken,
    ) -> Result<Rendered, Unfinished> {
        let _ = (self.listener, job, progress, cancel);
        Err(RenderError::Internal("not connected yet".into()).into())
    }
}

/// [`Farm::bind`] and [`Farm::render`] in one.
///
/// # Errors
/// Those of both.
pub async fn render(
    job: RenderJob,
    listen: ListenAddr,
    progress: watch::Sender<Progress>,
    cancel: CancellationToken,
) -> Result<Rendered, Unfinished> {
    Farm::bind(listen).await?.render(job, progress, cancel).await
}
