//! Real `worker` processes, killed, stopped and told to leave.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::sync::Arc;
use std::time::Duration;

use coordinator::{ListenAddr, PixelFormat, Pixels, RenderError};
use rustix::process::Signal;
use tessera_core::settings::Sampling;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::cluster::{Cluster, Running};
use tessera_tests::generate;
use tessera_tests::process::Process;
use tessera_tests::program;
use tessera_tests::renderers::{Gate, Painted, assert_painted};
use tokio_util::sync::CancellationToken;
use worker::Config;

const WIDTH: u32 = 256;

/// A picture so finely sampled that a real worker is busy with one tile of it far longer than
/// any of these tests takes; the painter in this process does not look at the scene at all.
fn endless() -> Cluster {
    let mut cluster = Cluster::of(generate::lights(60, 12).scene().unwrap()).size(WIDTH, 192).tile(64).workers(0, 1);
    cluster.job.settings.sampling = Sampling::Uniform { grid: Sampling::MAX_GRID };
    cluster
}

fn worker(running: &Running, more: &[&str]) -> Process {
    let addr = running.addr.to_string();
    Process::start("worker", &[&["--connect", &addr, "--threads", "1"], more].concat())
}

fn painter(running: &Running) {
    let config = Config {
        threads: 1,
        once: true,
        name: "painter".into(),
        factory: Arc::new(Painted),
        ..Config::new(running.addr.into())
    };
    tokio::spawn(async move { worker::run(config, CancellationToken::new()).await.unwrap() });
}

#[tokio::test]
async fn a_worker_killed_mid_render_does_not_cost_the_picture() {
    let mut running = endless().start().await;
    let victim = worker(&running, &["--name", "victim"]);
    running.until(|p| p.workers.first().is_some_and(|w| w.holds > 0)).await;
    victim.signal(Signal::KILL);
    running.until(|p| !p.workers[0].connected).await;
    painter(&running);
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!((rendered.workers[0].name.as_str(), rendered.workers[0].tiles), ("victim", 0));
    assert!(rendered.workers[0].lost > 0);
}

#[tokio::test]
async fn the_holder_of_the_last_tile_is_killed() {
    let mut running = endless().size(64, 64).start().await;
    let victim = worker(&running, &[]);
    running.until(|p| p.workers.first().is_some_and(|w| w.holds == 1)).await;
    victim.signal(Signal::KILL);
    running.until(|p| !p.workers[0].connected).await;
    painter(&running);
    let rendered = running.end().await.unwrap();
    assert_eq!((rendered.tiles, rendered.is_complete()), (1, true));
}

#[tokio::test]
async fn all_workers_killed_ends_the_render_or_others_come() {
    let mut cluster = endless();
    cluster.job.patience = Duration::from_millis(300).into();
    for others_come in [false, true] {
        if others_come {
            cluster.job.patience = Duration::from_secs(30).into();
        }
        let mut running = cluster.clone().start().await;
        let victims = [worker(&running, &["--name", "a"]), worker(&running, &["--name", "b"])];
        running.until(|p| p.workers.len() == 2 && p.workers.iter().all(|w| w.holds > 0)).await;
        victims.iter().for_each(|v| v.signal(Signal::KILL));
        running.until(|p| p.workers.iter().all(|w| !w.connected)).await;
        if others_come {
            painter(&running);
            assert_painted(&running.end().await.unwrap());
        } else {
            let unfinished = running.end().await.unwrap_err();
            assert!(matches!(unfinished.error, RenderError::NoWorkers { ever: true, .. }), "{unfinished}");
            assert!(unfinished.to_string().contains("connection lost"), "{unfinished}");
            assert!(!unfinished.to_string().contains("h2"), "{unfinished}");
        }
    }
}

#[tokio::test]
async fn a_stopped_process_is_noticed_and_comes_back_when_it_goes_on() {
    let mut running = endless().nervous().start().await;
    let mut frozen = worker(&running, &[]);
    running.until(|p| p.workers.first().is_some_and(|w| w.holds > 0)).await;
    frozen.signal(Signal::STOP);
    running.until(|p| p.workers[0].left.as_ref().is_some_and(|l| l.contains("nothing was heard"))).await;
    frozen.signal(Signal::CONT);
    frozen.says("WARN");
    running.until(|p| p.workers[0].connected).await;
    painter(&running);
    let rendered = running.end().await.unwrap();
    assert_painted(&rendered);
    assert_eq!(rendered.workers[0].tiles, 0);
}

#[tokio::test]
async fn a_stopped_process_does_not_hold_the_end_up() {
    let mut running = endless().nervous().start().await;
    let frozen = worker(&running, &[]);
    running.until(|p| p.workers.first().is_some_and(|w| w.holds > 0)).await;
    frozen.signal(Signal::STOP);
    painter(&running);
    assert_painted(&running.end().await.unwrap());
}

#[tokio::test]
async fn a_worker_that_joins_at_half_takes_its_part_and_the_bits_are_the_same() {
    let gate = Gate::after(150);
    let cluster = Cluster::of(generate::demo().scene().unwrap()).tile(8).factory(gate.clone());
    let prepared = Arc::new(PreparedScene::build(cluster.job.scene.scene().clone()));
    let wanted = Tracer::new(prepared, cluster.job.settings).unwrap().render(cluster.job.region).0;
    let mut running = cluster.start().await;
    running.until(|p| 2 * p.pixels_done >= p.pixels_total).await;
    let late = worker(&running, &["--name", "late", "--once"]);
    running.until(|p| p.workers.get(2).is_some_and(|w| w.tiles > 0)).await;
    gate.open();
    let rendered = running.end().await.unwrap();
    assert!(rendered.image == Pixels::F32(wanted.pixels));
    let (status, said) = late.end();
    assert!(status.success(), "{said}");
}

#[tokio::test]
async fn a_worker_told_to_leave_finishes_its_tile_and_nothing_is_lost() {
    let mut cluster = Cluster::of(generate::lights(60, 12).scene().unwrap()).size(1280, 960).tile(32).workers(0, 1);
    cluster.job.pixels = PixelFormat::Rgb8;
    let mut running = cluster.start().await;
    let leaving = worker(&running, &[]);
    running.until(|p| p.workers.first().is_some_and(|w| w.tiles > 0)).await;
    leaving.signal(Signal::TERM);
    running.until(|p| !p.workers[0].connected).await;
    let (status, said) = leaving.end();
    assert!(status.success(), "{said}");
    assert_eq!(running.worker(0).lost, 0, "{:?}", running.worker(0));
    painter(&running);
    assert!(running.end().await.unwrap().is_complete());
}

#[tokio::test]
async fn a_worker_outlives_its_coordinator_and_serves_the_next() {
    let cluster = || Cluster::of(generate::demo().scene().unwrap()).workers(0, 1);
    let mut running = cluster().start().await;
    let addr = running.addr;
    let mut steady = worker(&running, &["-v"]);
    running.until(|p| !p.workers.is_empty()).await;
    let first = running.end().await.unwrap();
    steady.says("waiting for the next");
    // Nobody is there for a while, and the worker says so.
    steady.says("cannot connect");
    let mut running = cluster().start_at(ListenAddr::Socket(addr)).await;
    running.until(|p| !p.workers.is_empty()).await;
    assert_eq!(running.end().await.unwrap().image, first.image);
    steady.says("the scene is here already");
}

#[test]
fn a_worker_says_in_the_farm_s_words_that_a_web_server_is_no_farm() {
    use std::io::{Read, Write};
    let server = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let addr = server.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        for mut stream in server.incoming().flatten() {
            let _ = stream.read(&mut [0; 1024]);
            let _ = stream.write_all(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
        }
    });
    let (status, said) = Process::start("worker", &["--connect", &addr, "--give-up-after", "1s"]).end();
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("no coordinator"), "{said}");
    for word in ["h2", "http2", "transport", "frame"] {
        assert!(!said.contains(word), "'{word}' is in: {said}");
    }
}

#[test]
fn a_worker_says_why_it_cannot_work() {
    let run = |args: &[&str]| {
        let (status, said) = Process::start("worker", args).end();
        (status.code(), said)
    };
    // A name may come to be known: it is tried again, as long as is wanted.
    let (code, said) = run(&["no-such-host.invalid", "--give-up-after", "300ms"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("no-such-host.invalid") && said.contains("gave up") && said.contains("trying again"),
        "{said}"
    );
    // Nothing is said twice in one line, and nothing in colour to a pipe.
    let (code, said) = run(&["--connect", "127.0.0.1:1", "--give-up-after", "300ms"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.lines().all(|l| l.matches("refused").count() <= 1) && !said.contains('\u{1b}'), "{said}");
    let (code, said) = run(&["localhost:1", "--lifetime", "200ms", "--lifetime-stagger", "100ms"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("lifetime is over"), "{said}");
    for bad in [&["--connect", "a b"][..], &["--connect", "x", "--threads", "0"], &[], &["--nonsense"]] {
        assert_eq!(run(bad).0, Some(2), "{bad:?}");
    }
    let (code, said) = run(&["--help"]);
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn processes_alone_give_the_file_that_one_process_gives_though_one_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let scene = program::scene("demo.xml");
    let render = |output: &str, more: &[&str]| {
        let common = ["render", scene.to_str().unwrap(), "--size", "160x120", "--tile", "8", "--output", output];
        Process::start("coordinator", &[&common, more].concat())
    };
    let (status, said) = render(&file("alone.png"), &[]).end();
    assert!(status.success(), "{said}");
    let mut coordinator = render(&file("farm.png"), &["--listen", "127.0.0.1:0"]);
    let said = coordinator.says("awaited on ");
    let addr = said.split("awaited on ").nth(1).unwrap().split(';').next().unwrap().to_owned();
    let worker = || Process::start("worker", &["--connect", &addr, "--once"]);
    let mut victim = worker();
    victim.says("registered");
    // Wherever it is by now, in the middle or at the end.
    victim.signal(Signal::KILL);
    let (others, (status, said)) = ([worker(), worker()], coordinator.end());
    assert!(status.success(), "{said}");
    assert_eq!(std::fs::read(file("alone.png")).unwrap(), std::fs::read(file("farm.png")).unwrap());
    // A worker that came too late waits for the next coordinator; the others have left.
    drop(others);
}
