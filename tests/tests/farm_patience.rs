//! Workers that get nowhere, vanish together, are strangers or far away: none of them costs the picture.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::sync::Arc;
use std::time::Duration;

use tessera_tests::cluster::{Cluster, Running};
use tessera_tests::fake::{self, Fake};
use tessera_tests::generate;
use tessera_tests::loopback;
use tessera_tests::proxy::Proxy;
use tessera_tests::renderers::{Gate, Painted, assert_painted};
use tokio_util::sync::CancellationToken;
use worker::{Backoff, Config, Left};

fn painted(width: u32, height: u32, tile: u32) -> Cluster {
    let cluster = Cluster::of(generate::demo().scene().unwrap()).size(width, height).tile(tile).nervous();
    cluster.factory(Painted).workers(0, 1)
}

fn config(addr: std::net::SocketAddr, factory: impl worker::RendererFactory + 'static, name: &str) -> Config {
    Config {
        threads: 1,
        name: name.into(),
        once: true,
        factory: Arc::new(factory),
        backoff: Backoff { first: Duration::from_millis(20), longest: Duration::from_millis(100) },
        ..Config::new(addr.into())
    }
}

fn comes(
    running: &Running,
    factory: impl worker::RendererFactory + 'static,
    name: &str,
) -> tokio::task::JoinHandle<Left> {
    let config = config(running.addr, factory, name);
    tokio::spawn(async move { worker::run(config, CancellationToken::new()).await.unwrap() })
}

#[tokio::test]
async fn workers_whose_threads_stand_still_do_not_hang_the_job() {
    for frozen in [1, 3, 8] {
        let mut running = painted(64, 48, 16).start().await;
        let gate = Gate::before(Painted, 0);
        for _ in 0..frozen {
            comes(&running, gate.clone(), "frozen");
        }
        running.until(|p| p.workers.iter().map(|w| w.holds).sum::<usize>() >= (2 * frozen).min(12)).await;
        comes(&running, Painted, "well");
        let rendered = running.end().await.unwrap();
        assert_painted(&rendered);
        assert!(rendered.workers[..frozen].iter().all(|w| w.tiles == 0), "{:?}", rendered.workers);
        gate.open();
    }
}

#[tokio::test]
async fn clocks_run_on_while_nothing_is_delivered() {
    let mut running = painted(64, 48, 16).start().await;
    let gate = Gate::before(Painted, 1);
    comes(&running, gate.clone(), "frozen");
    running.until(|p| p.tiles_done == 1).await;
    let then = running.progress.borrow().elapsed;
    running.until(|p| p.elapsed > then + Duration::from_millis(500)).await;
    assert_eq!(running.progress.borrow().tiles_done, 1);
    gate.open();
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn strangers_that_take_leases_and_leave_do_not_end_the_job() {
    let mut running = painted(64, 48, 16).start().await;
    let gate = Gate::before(Painted, 4);
    comes(&running, gate.clone(), "honest");
    running.until(|p| p.tiles_done == 4).await;
    for name in ["a", "bb", "ccc", "dddd", "eeeee"] {
        let mut stranger = Fake::ready(running.addr, name).await;
        stranger.lease().await;
        drop(stranger);
    }
    running.until(|p| p.workers[1..].len() == 5 && p.workers[1..].iter().all(|w| !w.connected)).await;
    gate.open();
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn all_holders_of_the_last_tile_vanish_together_and_others_come() {
    let mut running = painted(16, 16, 16).start().await;
    for round in 0..3 {
        let mut holders = Vec::new();
        for n in 0..3 {
            let register = fake::registration(&format!("holder-{round}-{n}"));
            let holder = Fake::register(running.addr, register).await.unwrap();
            holder.say(tessera_proto::wire::worker_message::Kind::Ready(tessera_proto::wire::Ready::default())).await;
            holders.push(holder);
        }
        // Copies are given when the first holder is overdue.
        running.until(|p| p.workers.iter().filter(|w| w.connected && w.holds > 0).count() == 3).await;
        drop(holders);
        running.until(|p| p.workers.iter().all(|w| !w.connected)).await;
    }
    comes(&running, Painted, "well");
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_result_on_a_slow_line_takes_longer_than_a_worker_may_be_silent() {
    // 786 kB in one message, of which a line of 2 Mbit/s takes three seconds; a second and a half of silence are
    // too long.
    let running = painted(256, 256, 256).start().await;
    let line = Proxy::throttled(running.addr, 250_000).await;
    let config = config(line.addr, Painted, "far");
    tokio::spawn(async move { worker::run(config, CancellationToken::new()).await });
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!((rendered.workers.len(), rendered.workers[0].lost), (1, 0), "{:?}", rendered.workers);
}

#[tokio::test]
async fn a_worker_leaves_when_its_life_is_over_and_gives_back_what_it_holds() {
    let mut running = painted(64, 48, 16).start().await;
    let gate = Gate::before(Painted, 3);
    let brief = Config { lifetime: Some(Duration::from_millis(400)), ..config(running.addr, gate.clone(), "brief") };
    let brief = tokio::spawn(worker::run(brief, CancellationToken::new()));
    running.until(|p| p.tiles_done == 3).await;
    // It finishes the tile at work first.
    tokio::time::sleep(Duration::from_millis(600)).await;
    gate.open();
    let left = tokio::time::timeout(Duration::from_secs(60), brief).await.unwrap().unwrap().unwrap();
    assert_eq!(left, Left::Expired);
    running.until(|p| !p.workers[0].connected).await;
    assert_eq!(running.worker(0).lost, 0);
    comes(&running, Painted, "next");
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_worker_gives_up_where_there_is_no_coordinator() {
    let nowhere = loopback::free();
    let config = Config { give_up_after: Some(Duration::from_millis(300)), ..config(nowhere, Painted, "lonely") };
    let end = worker::run(config, CancellationToken::new()).await.unwrap_err();
    assert!(matches!(end, worker::WorkerError::GaveUp { .. }), "{end}");
}
