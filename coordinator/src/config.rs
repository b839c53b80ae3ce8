//! What a render is told of places, sizes and times: below all that keep to it.

use std::net::SocketAddr;
use std::time::Duration;

/// Edge of a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TileSize {
    /// By measured cost.
    #[default]
    Auto,
    /// This many pixels, 1 to [`TileSize::MAX_EDGE`]; larger is taken as that.
    Edge(u32),
}

impl TileSize {
    /// The largest edge of a tile in pixels; its pixels fit one message in every format.
    pub const MAX_EDGE: u32 = 256;
}

/// Where workers are awaited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ListenAddr {
    /// 127.0.0.1, a free port: workers of this machine only.
    #[default]
    Loopback,
    /// This address; port 0 is a free one.
    Socket(SocketAddr),
}

/// How long a render goes on without any worker; [`Duration::MAX`] is for ever.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// Before the first one came.
    pub first: Duration,
    /// After the last one was lost.
    pub lost: Duration,
}

impl Default for Patience {
    /// Half a minute for the first, five after one was lost: machines start again in that time.
    fn default() -> Self {
        Self { first: Duration::from_secs(30), lost: Duration::from_secs(300) }
    }
}

impl From<Duration> for Patience {
    /// The same in both cases.
    fn from(time: Duration) -> Self {
        Self { first: time, lost: time }
    }
}

/// Times by which a farm lives.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Between two heartbeats of a worker.
    pub beat: Duration,
    /// Silence that makes a worker suspect.
    pub suspect_after: Duration,
    /// Silence that ends a worker's session.
    pub dead_after: Duration,
    /// How long a worker may take to fetch and prepare the scene.
    pub prepare_within: Duration,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            beat: Duration::from_millis(500),
            suspect_after: Duration::from_secs(2),
            dead_after: Duration::from_secs(5),
            prepare_within: Duration::from_secs(600),
        }
    }
}
