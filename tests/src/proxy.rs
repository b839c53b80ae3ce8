//! A network between worker and coordinator that fails when told to.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

/// What the network does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weather {
    /// Everything passes.
    Fair,
    /// Connections stand, and nothing passes.
    Silent,
    /// Connections break, and none is made.
    Broken,
}

/// Passes on to one address whatever comes, as the weather allows.
#[derive(Debug)]
pub struct Proxy {
    /// Where to connect instead.
    pub addr: SocketAddr,
    weather: watch::Sender<Weather>,
    /// Bytes that came from behind.
    down: Arc<AtomicU64>,
}

impl Proxy {
    /// Starts a network before `to`.
    ///
    /// # Panics
    /// When there is no loopback.
    pub async fn before(to: SocketAddr) -> Self {
        Self::throttled(to, usize::MAX).await
    }

    /// Starts a network before `to` that carries so many bytes a second either way.
    ///
    /// # Panics
    /// When there is no loopback.
    pub async fn throttled(to: SocketAddr, bytes_per_second: usize) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("loopback");
        let addr = listener.local_addr().expect("bound");
        let (weather, seen) = watch::channel(Weather::Fair);
        let down = Arc::new(AtomicU64::new(0));
        let count = down.clone();
        tokio::spawn(async move {
            while let Ok((near, _)) = listener.accept().await {
                if *seen.borrow() != Weather::Broken {
                    tokio::spawn(connect((near, to), seen.clone(), count.clone(), bytes_per_second));
                }
            }
        });
        Self { addr, weather, down }
    }

    /// Changes the weather.
    pub fn set(&self, weather: Weather) {
        self.weather.send_replace(weather);
    }

    /// Bytes that came from the far end so far.
    #[must_use]
    pub fn bytes_down(&self) -> u64 {
        self.down.load(Ordering::SeqCst)
    }
}

async fn connect(
    (near, to): (TcpStream, SocketAddr),
    mut weather: watch::Receiver<Weather>,
    down: Arc<AtomicU64>,
    pace: usize,
) {
    let Ok(far) = TcpStream::connect(to).await else { return };
    let ((near_in, near_out), (far_in, far_out)) = (near.into_split(), far.into_split());
    let up = pass(near_in, far_out, weather.clone(), Arc::default(), pace);
    let down = pass(far_in, near_out, weather.clone(), down, pace);
    tokio::select! {
        () = up => {}
        () = down => {}
        _ = weather.wait_for(|w| *w == Weather::Broken) => {}
    }
}

async fn pass(
    mut from: impl AsyncReadExt + Unpin,
    mut to: impl AsyncWriteExt + Unpin,
    mut weather: watch::Receiver<Weather>,
    count: Arc<AtomicU64>,
    pace: usize,
) {
    // A twentieth of a second's worth at a time.
    let mut buffer = vec![0; (pace / 20).clamp(1, 1 << 16)];
    while let Ok(n @ 1..) = from.read(&mut buffer).await {
        if weather.wait_for(|w| *w == Weather::Fair).await.is_err() {
            return;
        }
        count.fetch_add(n as u64, Ordering::SeqCst);
        if to.write_all(&buffer[..n]).await.is_err() {
            return;
        }
        if pace < usize::MAX {
            tokio::time::sleep(Duration::from_secs_f64(n as f64 / pace as f64)).await;
        }
    }
}
