//! Peers that hold connections, bodies and identities that are not for them, and coordinators that are none.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use coordinator::RenderError;
use tessera_proto::wire::worker_message::Kind as Say;
use tessera_proto::wire::{RayCounts, Register};
use tessera_tests::cluster::{Cluster, Running};
use tessera_tests::fake::{self, Fake};
use tessera_tests::generate;
use tessera_tests::hostile::{BEAT, Raw};
use tessera_tests::renderers::{Painted, assert_painted};
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use tonic::Code;
use worker::{Backoff, Config, Left, WorkerError};

const WIDTH: u32 = 64;

fn painted() -> Cluster {
    let cluster = Cluster::of(generate::demo().scene().unwrap()).size(WIDTH, 48).tile(16);
    cluster.factory(Painted).workers(0, 1)
}

fn config(addr: SocketAddr, name: &str) -> Config {
    Config {
        threads: 1,
        name: name.into(),
        once: true,
        factory: Arc::new(Painted),
        backoff: Backoff { first: Duration::from_millis(20), longest: Duration::from_millis(100) },
        ..Config::new(addr.into())
    }
}

fn comes(running: &Running) -> JoinHandle<Result<Left, WorkerError>> {
    tokio::spawn(worker::run(config(running.addr, "painter"), CancellationToken::new()))
}

#[tokio::test]
async fn connections_that_send_one_byte_or_half_a_preface_keep_nobody_out() {
    let running = painted().start().await;
    let mut held = Vec::new();
    for n in 0..400 {
        let mut stream = TcpStream::connect(running.addr).await.unwrap();
        let _ = stream.write_all(&b"PRI * HTTP/2.0\r\n"[..1 + n % 16]).await;
        held.push(stream);
    }
    comes(&running);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_connection_that_never_registers_is_closed() {
    let running = painted().start().await;
    let raw = Raw::plain(running.addr).await.unwrap();
    assert!(raw.call("/tessera.farm.v1.Farm/Greet", &[], &[0; 5], true).await.unwrap().status == Some(0));
    let closed = async {
        while raw.call("/tessera.farm.v1.Farm/Greet", &[], &[0; 5], true).await.is_ok() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(60), closed).await.expect("it stays open");
    comes(&running);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn requests_that_are_long_or_never_end_are_not_waited_for() {
    let running = painted().start().await;
    let raw = Raw::plain(running.addr).await.unwrap();
    // Of a message of 1 MiB, said to follow.
    let mut long = vec![0, 0, 16, 0, 0];
    long.resize(9000, 7);
    let answer = raw.call(BEAT, &[], &long, false).await.unwrap();
    assert_eq!(answer.status, Some(Code::ResourceExhausted as i32), "{answer:?}");
    let (one, other) = tokio::join!(raw.call(BEAT, &[], &long[..100], false), raw.call(BEAT, &[], &[], false));
    for answer in [one, other] {
        // The connection may go first: it never registered.
        assert!(answer.is_err() || answer.unwrap().status == Some(Code::DeadlineExceeded as i32));
    }
    comes(&running);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_key_alone_is_not_an_identity() {
    let mut running = painted().start().await;
    let mut owner = Fake::ready(running.addr, "owner").await;
    let lease = owner.lease().await;
    // Whoever saw the key says that it is his, with no proof, a made-up one, or one of another connection.
    let sniffed = fake::registration("owner");
    let replayed = fake::identity("owner").prove(&[7; 32]);
    for proof in [vec![1], vec![0; 64], replayed] {
        let status = Fake::register(running.addr, Register { proof, ..sniffed.clone() }).await.unwrap_err();
        assert_eq!(status.code(), Code::InvalidArgument, "{status}");
    }
    assert!(running.worker(0).connected, "the owner stays");
    owner.say(fake::done(&lease, fake::float_bytes(&lease))).await;
    running.until(|p| p.workers[0].tiles == 1).await;
    drop(owner);
    comes(&running);
    assert!(running.end().await.unwrap().is_complete());
}

#[tokio::test]
async fn whoever_broke_the_rules_is_shut_out_by_key_whatever_name_it_takes() {
    let running = painted().start().await;
    let mut forger = Fake::ready(running.addr, "forger").await;
    let mut lease = forger.lease().await;
    lease.lease += 1000;
    forger.say(fake::done(&lease, fake::float_bytes(&lease))).await;
    assert_eq!(forger.cut_off().await.code(), Code::InvalidArgument);
    let again = Fake::register(running.addr, fake::registration("forger")).await.unwrap_err();
    assert_eq!(again.code(), Code::PermissionDenied);
    assert!(again.metadata().contains_key("tessera-refused"), "for good");
    comes(&running);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn light_and_rays_that_no_scene_has_are_not_taken() {
    for case in ["dark", "bright", "rays"] {
        let running = painted().start().await;
        let mut liar = Fake::ready(running.addr, case).await;
        let lease = liar.lease().await;
        let Say::TileDone(mut done) = fake::done(&lease, fake::float_bytes(&lease)) else { unreachable!() };
        let mut pixels = done.pixels.to_vec();
        match case {
            "dark" => pixels[8..12].copy_from_slice(&(-3e38f32).to_le_bytes()),
            "bright" => pixels[8..12].copy_from_slice(&1e30f32.to_le_bytes()),
            _ => done.rays = Some(RayCounts { camera: 1 << 48, ..RayCounts::default() }),
        }
        done.pixels = pixels.into();
        liar.say(Say::TileDone(done)).await;
        assert_eq!(liar.cut_off().await.code(), Code::InvalidArgument, "{case}");
        comes(&running);
        assert_painted(&running.end().await.unwrap());
    }
}

#[tokio::test]
async fn names_disturb_no_line_and_pass_for_nobody_elses() {
    let mut running = painted().workers(1, 1).factory(tessera_tests::renderers::Gate::before(Painted, 0)).start().await;
    running.until(|p| p.workers.len() == 1).await;
    let odd = "a\u{202e}b\u{2028}c\u{1b}[2J";
    let _one = Fake::ready(running.addr, odd).await;
    let _other = Fake::ready(running.addr, "local-1").await;
    running.until(|p| p.workers.len() == 3).await;
    let names: Vec<String> = (0..3).map(|n| running.worker(n).name).collect();
    assert_eq!(names[0], "local-1");
    assert_eq!(names[2], "local-1 (remote)");
    assert!(!names[1].chars().any(tessera_core::text::disturbs), "{names:?}");
    running.cancel.cancel();
    assert!(matches!(running.end().await.unwrap_err().error, RenderError::Cancelled));
}

/// Some gRPC service that is no coordinator: it answers every call with this status.
async fn alien(status: &'static str) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let addr = listener.local_addr().unwrap();
    tokio::spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            tokio::spawn(async move {
                let mut connection = h2::server::handshake(stream).await.unwrap();
                while let Some(Ok((_, mut respond))) = connection.accept().await {
                    let answer = http::Response::builder()
                        .header("content-type", "application/grpc")
                        .header("grpc-status", status)
                        .body(())
                        .unwrap();
                    let _ = respond.send_response(answer, true);
                    let _: Bytes = Bytes::new();
                }
            });
        }
    });
    addr
}

#[tokio::test]
async fn another_service_at_the_port_does_not_end_a_worker() {
    // Unimplemented, permission denied, unauthenticated, failed precondition, invalid argument.
    for status in ["12", "7", "16", "9", "3"] {
        let addr = alien(status).await;
        let stop = CancellationToken::new();
        let work = tokio::spawn(worker::run(config(addr, "patient"), stop.clone()));
        tokio::time::sleep(Duration::from_millis(300)).await;
        assert!(!work.is_finished(), "status {status}");
        stop.cancel();
        assert_eq!(work.await.unwrap().unwrap(), Left::Stopped);
    }
}

#[tokio::test]
async fn a_scene_larger_than_a_worker_allows_is_not_taken_and_the_reason_is_told() {
    let mut running = painted().start().await;
    let small = Config { max_memory: 1000, ..config(running.addr, "small") };
    let stop = CancellationToken::new();
    let work = tokio::spawn(worker::run(small, stop.clone()));
    running.until(|p| p.workers.first().is_some_and(|w| w.left.is_some())).await;
    let left = running.worker(0).left.unwrap();
    assert!(left.contains("--max-memory"), "{left}");
    stop.cancel();
    work.await.unwrap().unwrap();
    comes(&running);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_worker_told_to_leave_does_not_wait_for_a_tile_without_end() {
    let mut running = painted().start().await;
    let gate = tessera_tests::renderers::Gate::before(Painted, 0);
    let config = Config {
        leave_within: Duration::from_millis(50),
        factory: Arc::new(gate.clone()),
        ..config(running.addr, "stuck")
    };
    let stop = CancellationToken::new();
    let work = tokio::spawn(worker::run(config, stop.clone()));
    running.until(|p| p.workers.first().is_some_and(|w| w.holds > 0)).await;
    stop.cancel();
    let left = tokio::time::timeout(Duration::from_secs(60), work).await.expect("it waits").unwrap().unwrap();
    assert_eq!(left, Left::Stopped);
    running.until(|p| !p.workers[0].connected).await;
    assert_eq!(running.worker(0).lost, 0, "it gave its tiles back");
    comes(&running);
    assert_painted(&running.end().await.unwrap());
    gate.open();
}
