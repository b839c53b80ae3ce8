//! Floods of HTTP/2 frames that mean nothing, from strangers: the render goes on beside them.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tessera_tests::cluster::Cluster;
use tessera_tests::generate;
use tessera_tests::renderers::{Painted, assert_painted};
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;
use tokio_util::sync::CancellationToken;
use worker::Config;

/// A frame of HTTP/2 (RFC 9113, 4.1).
fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let mut frame = (payload.len() as u32).to_be_bytes()[1..].to_vec();
    frame.extend([kind, flags]);
    frame.extend(stream.to_be_bytes());
    frame.extend(payload);
    frame
}

const DATA: u8 = 0;
const HEADERS: u8 = 1;
const RST_STREAM: u8 = 3;
const SETTINGS: u8 = 4;
const PING: u8 = 6;
const WINDOW_UPDATE: u8 = 8;
const CONTINUATION: u8 = 9;
const END_HEADERS: u8 = 4;

/// POST over http to "/": a request, by HPACK's static table alone.
const REQUEST: [u8; 3] = [0x83, 0x86, 0x84];

/// The `n`th piece of what one attacker sends on a connection.
type Attack = fn(u32) -> Vec<u8>;

/// Streams are opened and given up at once.
fn rapid_reset(n: u32) -> Vec<u8> {
    let stream = 2 * n + 1;
    [frame(HEADERS, END_HEADERS, stream, &REQUEST), frame(RST_STREAM, 0, stream, &[0, 0, 0, 8])].concat()
}

/// Headers that never end.
fn continuation(n: u32) -> Vec<u8> {
    // A field without indexing: a name and a value of a few letters.
    let field = [&[0x00, 4][..], b"name", &[100], &[b'v'; 100]].concat().repeat(150);
    match n {
        0 => frame(HEADERS, 0, 1, &REQUEST),
        _ => frame(CONTINUATION, 0, 1, &field),
    }
}

/// Questions that ask for an answer each, which nobody reads.
fn pings(_: u32) -> Vec<u8> {
    frame(PING, 0, 0, &[7; 8]).repeat(100)
}

fn settings(n: u32) -> Vec<u8> {
    // The initial window, larger and smaller in turns.
    let window = 65_535 - n % 2;
    frame(SETTINGS, 0, 0, &[&[0, 4][..], &window.to_be_bytes()].concat()).repeat(100)
}

/// Empty pieces of a message that never comes.
fn empty_data(n: u32) -> Vec<u8> {
    match n {
        0 => frame(HEADERS, END_HEADERS, 1, &REQUEST),
        _ => frame(DATA, 0, 1, &[]).repeat(100),
    }
}

fn windows(_: u32) -> Vec<u8> {
    frame(WINDOW_UPDATE, 0, 0, &[0, 0, 0, 1]).repeat(100)
}

/// A frame of a kind that there is not, of the largest size allowed.
fn unknown(_: u32) -> Vec<u8> {
    frame(0x42, 0xff, 0, &[0; 16_384])
}

/// A frame that is said to be longer than is allowed.
fn too_long(_: u32) -> Vec<u8> {
    let mut frame = frame(DATA, 0, 1, &[0; 64]);
    frame[..3].fill(0xff);
    frame
}

/// Attacks until it is stopped, on a new connection whenever one is closed; counts pieces, and connections.
async fn attack(addr: SocketAddr, attack: Attack, (sent, closed): (Arc<AtomicU64>, Arc<AtomicU64>)) {
    loop {
        let Ok(mut stream) = TcpStream::connect(addr).await else {
            tokio::time::sleep(Duration::from_millis(5)).await;
            continue;
        };
        let hello = [&b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"[..], &frame(SETTINGS, 0, 0, &[])].concat();
        let mut alive = stream.write_all(&hello).await.is_ok();
        let mut n = 0;
        while alive {
            let piece = attack(n);
            // Where nobody reads it any more, another connection is tried.
            let wrote = tokio::time::timeout(Duration::from_secs(1), stream.write_all(&piece)).await;
            alive = matches!(wrote, Ok(Ok(())));
            sent.fetch_add(1, Ordering::Relaxed);
            n = (n + 1) % (1 << 29);
            tokio::task::yield_now().await;
        }
        closed.fetch_add(1, Ordering::Relaxed);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn floods_of_frames_keep_nobody_from_rendering() {
    let attacks: [(&str, Attack); 8] = [
        ("rapid reset", rapid_reset),
        ("endless headers", continuation),
        ("pings", pings),
        ("settings", settings),
        ("empty data", empty_data),
        ("window updates", windows),
        ("frames of no kind", unknown),
        ("frames that are too long", too_long),
    ];
    for (name, kind) in attacks {
        let cluster = Cluster::of(generate::demo().scene().unwrap()).size(64, 48).tile(16);
        let running = cluster.factory(Painted).workers(0, 1).start().await;
        let (sent, closed) = (Arc::<AtomicU64>::default(), Arc::<AtomicU64>::default());
        let attackers: Vec<_> =
            (0..4).map(|_| tokio::spawn(attack(running.addr, kind, (sent.clone(), closed.clone())))).collect();
        let under_way = async {
            while sent.load(Ordering::Relaxed) < 2000 && closed.load(Ordering::Relaxed) < 20 {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(60), under_way).await.expect(name);
        let config = Config {
            threads: 1,
            name: "painter".into(),
            once: true,
            factory: Arc::new(Painted),
            ..Config::new(running.addr.into())
        };
        tokio::spawn(worker::run(config, CancellationToken::new()));
        assert_painted(&running.end().await.expect(name));
        attackers.iter().for_each(tokio::task::JoinHandle::abort);
        let (sent, closed) = (sent.load(Ordering::Relaxed), closed.load(Ordering::Relaxed));
        println!("{name}: {sent} pieces sent, {closed} connections closed");
    }
}
