//! HTTP as it is on the wire, so that what no polite client sends can be sent.

use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use serde_json::Value;
use tessera_proto::credential::certificates;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::ServerName;
use tokio_rustls::rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

/// Longer than anything here takes.
const NEVER: Duration = Duration::from_secs(60);

/// The line of a head that no form can send.
pub const OWN_REQUEST: &str = "X-Tessera: 1\r\n";

/// An answer.
#[derive(Debug)]
pub struct Answer {
    /// Its number.
    pub status: u16,
    /// All of its head.
    pub head: String,
    /// What follows.
    pub body: Vec<u8>,
}

impl Answer {
    /// The body as JSON.
    ///
    /// # Panics
    /// When it is none.
    #[must_use]
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&self.body)))
    }

    /// The line of the head that begins with `name`, without it.
    #[must_use]
    pub fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().find_map(|line| {
            let (key, value) = line.split_once(':')?;
            key.eq_ignore_ascii_case(name).then_some(value.trim())
        })
    }
}

/// Asks `at` for `path` with these more lines of a head.
///
/// # Panics
/// When there is no answer.
#[must_use]
pub fn http(at: &str, method: &str, path: &str, more: &str) -> Answer {
    let mut stream = TcpStream::connect(at).expect("somebody listens");
    stream.set_read_timeout(Some(NEVER)).expect("a time limit");
    ask(&mut stream, at, (method, path, more), "")
}

/// What is asked, of a stream that leads to `host`: method, path and more lines of the head.
///
/// # Panics
/// When there is no answer.
#[must_use]
pub fn ask<S: Read + Write>(
    stream: &mut S,
    host: &str,
    (method, path, more): (&str, &str, &str),
    body: &str,
) -> Answer {
    let mut head = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
    if !more.contains("Host:") {
        let _ = write!(head, "Host: {host}\r\n");
    }
    stream.write_all(format!("{head}{more}\r\n{body}").as_bytes()).expect("it is heard");
    let mut all = Vec::new();
    let mut piece = [0; 4096];
    // Events never end: the first will do.
    let one_event = path.contains("/events");
    while !(one_event && all.windows(2).any(|w| w == b"}\n")) {
        match stream.read(&mut piece) {
            Ok(0) => break,
            Ok(read) => all.extend_from_slice(&piece[..read]),
            // Some end without a farewell of TLS.
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => break,
            Err(e) => panic!("{method} {path}: {e}"),
        }
    }
    let end = all.windows(4).position(|w| w == b"\r\n\r\n").expect("a head");
    let head = String::from_utf8_lossy(&all[..end]).into_owned();
    let status = head.split(' ').nth(1).and_then(|n| n.parse().ok()).expect("a status");
    Answer { status, head, body: all[end + 4..].to_vec() }
}

/// A client that knows the authority in a PEM file, and nobody else.
#[derive(Clone, Debug)]
pub struct Secure(Arc<ClientConfig>);

impl Secure {
    /// For servers whose certificate is of this authority.
    ///
    /// # Panics
    /// When there is none in the file.
    #[must_use]
    pub fn knowing(authority: &Path) -> Self {
        let mut roots = RootCertStore::empty();
        for certificate in certificates(authority).expect("certificates") {
            roots.add(certificate).expect("an authority");
        }
        let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .expect("TLS")
            .with_root_certificates(roots)
            .with_no_client_auth();
        Self(Arc::new(config))
    }

    /// As [`http()`], over TLS with the server at this port of this machine, which is called `localhost`.
    ///
    /// # Panics
    /// When there is no answer.
    #[must_use]
    pub fn ask(&self, port: u16, request: (&str, &str, &str), body: &str) -> Answer {
        let stream = TcpStream::connect(("127.0.0.1", port)).expect("somebody listens");
        stream.set_read_timeout(Some(NEVER)).expect("a time limit");
        let name = ServerName::try_from("localhost").expect("a name");
        let client = ClientConnection::new(self.0.clone(), name).expect("a client");
        ask(&mut StreamOwned::new(client, stream), &format!("localhost:{port}"), request, body)
    }
}
