//! Addresses of this machine alone.

use std::net::{SocketAddr, TcpListener};

/// One where nobody listens.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn free() -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    listener.local_addr().expect("it is bound")
}
