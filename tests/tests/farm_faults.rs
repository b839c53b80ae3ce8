//! Workers that fail, lie and vanish, and a network that breaks.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::sync::Arc;
use std::time::Duration;

use coordinator::{Farm, ListenAddr, Pixels, RenderError, SceneSource};
use tessera_core::film::Region;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_proto::wire::coordinator_message::Kind as Hear;
use tessera_proto::wire::worker_message::Kind as Say;
use tessera_proto::wire::{BeatRequest, Draining, LeaseReturned, Ready, Register, SceneRequest, TileFailed};
use tessera_tests::cluster::{Cluster, Running};
use tessera_tests::fake::{self, Fake};
use tessera_tests::generate;
use tessera_tests::proxy::{Proxy, Weather};
use tessera_tests::renderers::{Failure, Gate, Painted, Poisoned, assert_painted, paint};
use tokio_util::sync::CancellationToken;
use tonic::Code;
use worker::{Backoff, Config, Left};

const WIDTH: u32 = 64;

/// A painted picture of 64x48 in tiles of 16 without any worker, and quick to lose patience
/// with silent ones.
fn painted() -> Cluster {
    let cluster = Cluster::of(generate::demo().scene().unwrap()).size(WIDTH, 48).tile(16).nervous();
    cluster.factory(Painted).workers(0, 1)
}

/// A worker like those from elsewhere: it fetches the scene, and paints.
fn comes(running: &Running, factory: impl worker::RendererFactory + 'static) -> tokio::task::JoinHandle<Left> {
    comes_to(running.addr, factory, "painter")
}

fn comes_to(
    addr: std::net::SocketAddr,
    factory: impl worker::RendererFactory + 'static,
    name: &str,
) -> tokio::task::JoinHandle<Left> {
    let config = Config {
        threads: 1,
        name: name.into(),
        once: true,
        factory: Arc::new(factory),
        backoff: Backoff { first: Duration::from_millis(20), longest: Duration::from_millis(100) },
        ..Config::new(addr.into())
    };
    tokio::spawn(async move { worker::run(config, CancellationToken::new()).await.unwrap() })
}

#[tokio::test]
async fn a_forged_answer_ends_the_session_and_costs_nothing() {
    let running = painted().start().await;
    let mut forger = Fake::ready(running.addr, "forger").await;
    let mut lease = forger.lease().await;
    lease.lease += 1000;
    forger.say(fake::done(&lease, fake::float_bytes(&lease))).await;
    let status = forger.cut_off().await;
    assert_eq!(status.code(), Code::InvalidArgument, "{status}");
    // It is not welcome any more, whatever it calls itself.
    let again = Fake::register(running.addr, fake::registration("forger")).await.unwrap_err();
    assert_eq!(again.code(), Code::PermissionDenied);
    comes(&running, Painted);
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert!(rendered.workers[0].left.as_ref().unwrap().contains("does not hold"), "{:?}", rendered.workers[0]);
    assert_eq!((rendered.workers[0].tiles, rendered.workers[0].lost), (0, 2));
}

#[tokio::test]
async fn a_wrong_attempt_is_a_forgery() {
    let running = painted().start().await;
    let mut forger = Fake::ready(running.addr, "forger").await;
    let mut lease = forger.lease().await;
    lease.attempt += 1;
    forger.say(fake::done(&lease, fake::float_bytes(&lease))).await;
    assert_eq!(forger.cut_off().await.code(), Code::InvalidArgument);
    comes(&running, Painted);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_second_answer_to_one_lease_ends_the_session_and_the_first_counts_once() {
    let running = painted().start().await;
    let mut twice = Fake::ready(running.addr, "twice").await;
    let lease = twice.lease().await;
    for _ in 0..2 {
        twice.say(fake::done(&lease, fake::float_bytes(&lease))).await;
    }
    assert_eq!(twice.cut_off().await.code(), Code::InvalidArgument);
    comes(&running, Painted);
    let rendered = running.end().await.unwrap();
    assert!(rendered.is_complete());
    assert_eq!(rendered.workers[0].tiles, 1);
    assert_eq!(rendered.done.iter().map(Region::area).sum::<u64>(), 64 * 48, "no region is counted twice");
}

#[tokio::test]
async fn tiles_of_a_wrong_size_or_without_numbers_are_not_taken() {
    for (case, name) in ["1234", "12345", "123456", "1234567", "12345678"].into_iter().enumerate() {
        let running = painted().start().await;
        let mut liar = Fake::ready(running.addr, name).await;
        let lease = liar.lease().await;
        let right = fake::float_bytes(&lease);
        let answer = match case {
            0 => fake::done(&lease, right - 12),
            1 => fake::done(&lease, right + 12),
            2 => fake::done(&lease, right - 1),
            3 => fake::done(&lease, 0),
            _ => {
                let Say::TileDone(mut done) = fake::done(&lease, right) else { unreachable!() };
                let mut pixels = vec![0u8; right];
                pixels[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
                done.pixels = pixels.into();
                Say::TileDone(done)
            }
        };
        liar.say(answer).await;
        assert_eq!(liar.cut_off().await.code(), Code::InvalidArgument, "case {case}");
        comes(&running, Painted);
        assert_painted(&running.end().await.unwrap());
    }
}

#[tokio::test]
async fn a_message_over_the_limit_ends_the_session() {
    let running = painted().start().await;
    let mut loud = Fake::ready(running.addr, "loud").await;
    let lease = loud.lease().await;
    loud.say(fake::done(&lease, 3 << 20)).await;
    let status = loud.cut_off().await;
    assert!(matches!(status.code(), Code::OutOfRange | Code::Cancelled | Code::Unknown | Code::Internal), "{status}");
    comes(&running, Painted);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn floods_of_small_words_end_the_session() {
    let words = |n: usize| match n {
        0 => Say::Ready(Ready::default()),
        1 => Say::Draining(Draining {}),
        2 => Say::LeaseReturned(LeaseReturned { lease: 99, attempt: 0 }),
        3 => Say::TileFailed(TileFailed { lease: 99, attempt: 0, cause: "?".into() }),
        _ => Say::Register(fake::registration("again")),
    };
    for n in 0..5 {
        let running = painted().start().await;
        let mut flood = Fake::ready(running.addr, "flood").await;
        for _ in 0..100 {
            flood.say(words(n)).await;
        }
        assert_eq!(flood.cut_off().await.code(), Code::InvalidArgument, "case {n}");
        comes(&running, Painted);
        assert_painted(&running.end().await.unwrap());
    }
}

#[tokio::test]
async fn whoever_does_not_fit_is_refused_with_the_reason() {
    let running = painted().start().await;
    let good = fake::registration("old");
    for (bad, reason) in [
        (Register { protocol: 0, ..good.clone() }, "protocol"),
        (Register { build: "0.0.1".into(), ..good.clone() }, "build"),
        (Register { numeric_mode: "fast".into(), ..good.clone() }, "mode"),
    ] {
        let status = Fake::register(running.addr, bad).await.unwrap_err();
        assert_eq!(status.code(), Code::FailedPrecondition);
        assert!(status.message().contains(reason), "{status}");
    }
    for bad in [
        Register { threads: 0, ..good.clone() },
        Register { name: "x".repeat(1000), ..good.clone() },
        Register { local: vec![0; 16], ..good.clone() },
    ] {
        assert_eq!(Fake::register(running.addr, bad).await.unwrap_err().code(), Code::InvalidArgument);
    }
    for words in [None, Some(Say::Ready(Ready::default()))] {
        let status = Fake::first_words(running.addr, words).await.unwrap_err();
        assert_eq!(status.code(), Code::InvalidArgument);
    }
    comes(&running, Painted);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn calls_without_a_session_are_refused() {
    let running = painted().start().await;
    let mut fake = Fake::register(running.addr, fake::registration("curious")).await.unwrap();
    let stranger = fake.welcome.session ^ 1;
    let status = fake.client.beat(BeatRequest { session: stranger }).await.unwrap_err();
    assert_eq!(status.code(), Code::NotFound);
    let request = |session, hash: u8| SceneRequest { session, scene_sha256: vec![hash; 32] };
    let status = fake.client.fetch_scene(request(stranger, 0)).await.unwrap_err();
    assert_eq!(status.code(), Code::NotFound);
    let status = fake.client.fetch_scene(request(fake.welcome.session, 0)).await.unwrap_err();
    assert_eq!(status.code(), Code::NotFound, "another scene");
    drop(fake);
    comes(&running, Painted);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_late_result_is_dropped_and_its_worker_kept() {
    let mut running = painted().start().await;
    let mut late = Fake::ready(running.addr, "late").await;
    let lease = late.lease().await;
    // Everything else is done by another, then the tiles that are late.
    let gate = Gate::before(Painted, 11);
    comes(&running, gate.clone());
    running.until(|p| p.tiles_done == 11).await;
    let revoked = loop {
        match late.hear().await.unwrap() {
            Some(Hear::Revoke(revoke)) => break revoke.lease,
            Some(Hear::Lease(_)) => {}
            other => panic!("{other:?}"),
        }
    };
    if revoked == lease.lease {
        late.say(fake::done(&lease, fake::float_bytes(&lease))).await;
    }
    gate.open();
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!(rendered.workers[0].tiles, 0);
    loop {
        match late.hear().await.unwrap() {
            Some(Hear::Finished(_)) => break,
            Some(_) => {}
            None => panic!("no farewell"),
        }
    }
}

#[tokio::test]
async fn a_silent_worker_loses_its_tiles_and_its_session() {
    let mut running = painted().start().await;
    let mut silent = Fake::ready(running.addr, "silent").await;
    silent.lease().await;
    silent.falls_silent();
    running.until(|p| p.workers[0].left.is_some()).await;
    assert_eq!(silent.cut_off().await.code(), Code::DeadlineExceeded);
    comes(&running, Painted);
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!(rendered.workers[0].lost, 2);
}

#[tokio::test]
async fn a_worker_on_a_slow_tile_is_not_taken_for_dead() {
    let mut running = painted().start().await;
    let gate = Gate::before(Painted, 0);
    comes(&running, gate.clone());
    running.until(|p| p.workers.first().is_some_and(|w| w.holds > 0)).await;
    // Longer than silence would be forgiven.
    tokio::time::sleep(Duration::from_millis(2500)).await;
    assert!(running.worker(0).connected);
    gate.open();
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!(rendered.workers[0].lost, 0);
}

#[tokio::test]
async fn a_cut_connection_is_restored_and_the_scene_is_not_fetched_again() {
    let mut cluster = painted();
    let mesh = generate::knot_scene(200, 40).scene().unwrap();
    let scene_bytes = tessera_proto::scene::describe(&mesh).1;
    assert!(scene_bytes > 1 << 20);
    cluster.job.scene = SceneSource::Resolved(Arc::new(mesh));
    let mut running = cluster.start().await;
    let proxy = Proxy::before(running.addr).await;
    let gate = Gate::before(Painted, 4);
    comes_to(proxy.addr, gate.clone(), "far");
    for weather in [Weather::Broken, Weather::Silent] {
        running.until(|p| p.tiles_done >= 4 && p.workers[0].connected && p.workers[0].holds > 0).await;
        proxy.set(weather);
        running.until(|p| !p.workers[0].connected).await;
        proxy.set(Weather::Fair);
    }
    running.until(|p| p.workers[0].connected).await;
    gate.open();
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!(rendered.workers.len(), 1, "it is the same worker");
    assert!(proxy.bytes_down() < scene_bytes * 3 / 2, "{} bytes for a scene of {scene_bytes}", proxy.bytes_down());
}

#[tokio::test]
async fn two_workers_of_one_name_both_work() {
    let mut running = painted().tile(4).start().await;
    let gate = Gate::before(Painted, 2);
    comes_to(running.addr, gate.clone(), "twin");
    comes_to(running.addr, gate.clone(), "twin");
    running.until(|p| p.workers.len() == 2 && p.workers.iter().all(|w| w.holds > 0)).await;
    assert_ne!(running.worker(0).name, running.worker(1).name);
    gate.open();
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_worker_that_dials_again_takes_the_place_of_its_old_session() {
    let mut running = painted().start().await;
    let mut old = Fake::ready(running.addr, "lost its router").await;
    old.lease().await;
    let new = Fake::ready(running.addr, "lost its router").await;
    running.until(|p| p.workers[0].connected && p.workers[0].lost == 2 && p.workers[0].holds == 2).await;
    assert_eq!(running.progress.borrow().workers.len(), 1);
    drop((old, new));
    comes(&running, Painted);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_tile_that_fails_everywhere_ends_the_render_with_its_place_and_cause() {
    for (failure, words) in [(Failure::Panic, "poison at 20,40"), (Failure::NotANumber, "not finite")] {
        let cluster = painted().factory(Poisoned { pixel: (20, 40), failure }).workers(2, 1);
        let unfinished = cluster.start().await.end().await.unwrap_err();
        let RenderError::Tile { region, cause, .. } = &unfinished.error else { panic!("{unfinished}") };
        assert_eq!(*region, Region::new(16, 32, 32, 48).unwrap());
        assert!(cause.contains(words), "{cause}");
        let partial = unfinished.partial.unwrap();
        assert!(!partial.done.contains(region));
    }
}

#[tokio::test]
async fn nobody_for_too_long_ends_the_render() {
    let mut cluster = painted();
    cluster.job.patience = Duration::from_millis(100).into();
    let unfinished = cluster.clone().start().await.end().await.unwrap_err();
    assert!(matches!(unfinished.error, RenderError::NoWorkers { ever: false, .. }), "{unfinished}");
    let running = cluster.start().await;
    let mut fake = Fake::ready(running.addr, "brief").await;
    let lease = fake.lease().await;
    fake.say(fake::done(&lease, fake::float_bytes(&lease))).await;
    fake.lease().await;
    fake.lease().await;
    drop(fake);
    let unfinished = running.end().await.unwrap_err();
    assert!(matches!(unfinished.error, RenderError::NoWorkers { ever: true, .. }), "{unfinished}");
    assert_eq!(unfinished.partial.unwrap().done.len(), 1, "what was done is kept");
}

#[tokio::test]
async fn a_stopped_render_keeps_what_is_done() {
    let gate = Gate::before(Painted, 5);
    let mut running = painted().factory(gate.clone()).workers(2, 1).start().await;
    running.until(|p| p.tiles_done == 5).await;
    running.cancel.cancel();
    let unfinished = running.end().await.unwrap_err();
    assert!(matches!(unfinished.error, RenderError::Cancelled));
    let partial = unfinished.partial.unwrap();
    assert_eq!((partial.done.len(), partial.is_complete()), (5, false));
    let Some(Pixels::F32(pixels)) = partial.image.pixels() else { panic!("not floats") };
    for region in &partial.done {
        assert_eq!(pixels[(region.y0 * WIDTH + region.x0) as usize], paint(region.x0, region.y0));
    }
    gate.open();
}

#[tokio::test]
async fn a_port_in_use_is_said_before_anything_is_done() {
    let farm = Farm::bind(ListenAddr::Loopback).await.unwrap();
    let taken = farm.addr();
    let error = Farm::bind(ListenAddr::Socket(taken)).await.unwrap_err();
    assert!(error.to_string().contains(&taken.to_string()), "{error}");
}

#[tokio::test]
async fn workers_may_come_before_there_is_anything_to_render() {
    let mut farm = Farm::bind(ListenAddr::Loopback).await.unwrap();
    farm.hire(1, 1);
    let early = comes_to(farm.addr(), Painted, "early");
    // Nobody is answered yet, and who does not wait for that is in nobody's way.
    let brief = Fake::register(farm.addr(), fake::registration("brief"));
    assert!(tokio::time::timeout(Duration::from_millis(200), brief).await.is_err());
    let gate = Gate::before(Painted, 0);
    let mut running = painted().factory(gate.clone()).workers(1, 1).start_on(farm);
    running.until(|p| p.workers.iter().filter(|w| w.connected).count() == 2).await;
    gate.open();
    assert_painted(&running.end().await.unwrap());
    assert_eq!(tokio::time::timeout(Duration::from_secs(60), early).await.unwrap().unwrap(), Left::Finished);
}

#[tokio::test]
async fn a_worker_leaves_whose_scene_will_never_come() {
    let farm = Farm::bind(ListenAddr::Loopback).await.unwrap();
    let (never, tracer) = tokio::sync::watch::channel(None);
    let local = Some(worker::LocalScene { secret: tessera_proto::token::Secret::from([0; 16]), tracer });
    let config = Config { local, once: true, ..Config::new(farm.addr().into()) };
    let hired = tokio::spawn(worker::run(config, CancellationToken::new()));
    drop(never);
    let left = tokio::time::timeout(Duration::from_secs(60), hired).await.unwrap().unwrap();
    assert_eq!(left.unwrap(), Left::Stopped);
}

#[tokio::test]
async fn connections_that_say_nothing_are_in_nobodys_way() {
    let running = painted().start().await;
    let mut silent = Vec::new();
    for _ in 0..50 {
        silent.push(tokio::net::TcpStream::connect(running.addr).await.unwrap());
    }
    comes(&running, Painted);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_worker_leaves_when_there_is_no_more_work() {
    let running = painted().start().await;
    let worker = comes(&running, Painted);
    assert_painted(&running.end().await.unwrap());
    let left = tokio::time::timeout(Duration::from_secs(60), worker).await.unwrap().unwrap();
    assert_eq!(left, Left::Finished);
}

#[tokio::test]
async fn a_scene_from_afar_gives_the_same_bits() {
    let cluster = Cluster::of(generate::demo().scene().unwrap()).workers(0, 1);
    let prepared = Arc::new(PreparedScene::build(cluster.job.scene.scene().clone()));
    let wanted = Tracer::new(prepared, cluster.job.settings).unwrap().render(cluster.job.region).0;
    let running = cluster.start().await;
    comes(&running, worker::Exact);
    let rendered = running.end().await.unwrap();
    assert!(rendered.image == Pixels::F32(wanted.pixels));
}
