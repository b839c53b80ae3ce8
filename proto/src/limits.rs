//! What `farm.proto` promises in numbers.

use std::time::Duration;

/// Version of `farm.proto`.
pub const PROTOCOL: u32 = 5;

/// The program's version and a hash of the sources that decide pixels: what workers, journals and reports are
/// held to.
pub const BUILD: &str = concat!(env!("CARGO_PKG_VERSION"), "+", env!("TESSERA_SOURCES"));

/// How numbers become pixels: to be raised with any change of a pixel's bits, which the golden hashes
/// (`tests/golden`) tell.
pub const NUMERIC_MODE: &str = "f64-nearest-denormals-8";

/// Where workers are awaited unless a port is given.
pub const DEFAULT_PORT: u16 = 4747;

/// No message is longer, in either direction.
pub const MAX_MESSAGE_BYTES: usize = 1 << 20;

/// Pixels of a lease at most: 768 KiB as floats.
pub const MAX_TILE_PIXELS: u64 = 1 << 16;

/// Leases that a coordinator lets one worker hold, and revoked ones that it may owe an answer to; a
/// worker ends the session of a coordinator that goes further.
pub const MAX_LEASES: usize = 1024;

/// No request beside a session's stream is longer: none has more to say.
pub const MAX_REQUEST_BYTES: usize = 4 << 10;

/// Length of a piece of a scene.
pub const SCENE_PIECE_BYTES: usize = 256 << 10;

/// A scene's binary form is never longer.
pub const MAX_SCENE_BYTES: u64 = 64 << 30;

/// Threads of one worker at most.
pub const MAX_THREADS: u32 = 4096;

/// A worker's name is cut to this.
pub const MAX_NAME_BYTES: usize = 64;

/// A cause is cut to this.
pub const MAX_CAUSE_BYTES: usize = 1024;

/// How soon after connecting a worker registers, and is answered.
pub const REGISTER_WITHIN: Duration = Duration::from_secs(5);

/// HTTP/2 pings go out this often, also while idle.
pub const KEEPALIVE_INTERVAL: Duration = Duration::from_secs(2);

/// An HTTP/2 ping unanswered for this long ends the connection. On a slow line an answer waits behind results:
/// it is heartbeats, and bytes, that show life sooner.
pub const KEEPALIVE_TIMEOUT: Duration = Duration::from_secs(30);

/// `text`, cut to `bytes` bytes at a character's edge.
#[must_use]
pub fn cut(text: &str, bytes: usize) -> &str {
    let mut end = text.len().min(bytes);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    &text[..end]
}
