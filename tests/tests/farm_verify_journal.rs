//! Renders whose tiles are verified, ended half-way, and gone on with: what was confirmed stays so, and what was
//! taken back does not return.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use coordinator::journal::{Journal, JournalError};
use coordinator::{Goal, Pixels, Rendered};
use tessera_core::settings::Sampling;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::cluster::Cluster;
use tessera_tests::generate;
use tessera_tests::journal::Contents;
use tessera_tests::renderers::{Gate, Liar, Lie};
use tokio_util::sync::CancellationToken;
use worker::{Config, Exact, RendererFactory};

/// A share that draws nothing beyond the first two tiles of a worker.
const NEXT_TO_NOTHING: f64 = 1e-12;

fn demo(verify: f64) -> Cluster {
    let mut cluster = Cluster::of(generate::demo().scene().unwrap()).size(256, 192).tile(16).workers(0, 1);
    cluster.job.verify = verify;
    cluster
}

fn directly(cluster: &Cluster) -> Pixels {
    let prepared = Arc::new(PreparedScene::build(cluster.job.scene.scene().clone()));
    Pixels::F32(Tracer::new(prepared, cluster.job.settings).unwrap().render(cluster.job.region).0.pixels)
}

/// The journal at `path`, once whoever wrote it has let go of it.
async fn journal(path: &Path) -> Arc<Journal> {
    loop {
        match Journal::open(path, false) {
            Ok(journal) => return Arc::new(journal.after(Duration::ZERO)),
            Err(JournalError::Busy(_)) => tokio::task::yield_now().await,
            Err(e) => panic!("{e}"),
        }
    }
}

fn comes(addr: SocketAddr, name: &str, factory: impl RendererFactory + 'static) {
    let config =
        Config { threads: 1, name: name.into(), once: true, factory: Arc::new(factory), ..Config::new(addr.into()) };
    tokio::spawn(worker::run(config, CancellationToken::new()));
}

/// Renders until `so`, and until `kept` holds of the journal, and stops.
async fn begin(
    mut cluster: Cluster,
    path: &Path,
    workers: Vec<(&str, Arc<dyn RendererFactory>)>,
    so: impl FnMut(&coordinator::Progress) -> bool,
    kept: impl Fn(&Contents) -> bool,
) -> Contents {
    let journal = journal(path).await;
    cluster.job.journal = Some(journal.clone());
    let mut running = cluster.start().await;
    for (n, (name, factory)) in workers.into_iter().enumerate() {
        let config = Config { threads: 1, name: name.into(), once: true, factory, ..Config::new(running.addr.into()) };
        tokio::spawn(worker::run(config, CancellationToken::new()));
        running.until(|p| p.workers.len() > n).await;
    }
    running.until(so).await;
    let is_kept = async {
        while !kept(&Contents::read(path)) {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(60), is_kept).await.unwrap();
    running.cancel.cancel();
    running.end().await.unwrap_err();
    assert_eq!(journal.kept(), Some(path));
    Contents::read(path)
}

/// Goes on to the end, with two honest workers.
async fn go_on(mut cluster: Cluster, path: &Path) -> Rendered {
    cluster.job.journal = Some(journal(path).await);
    let running = cluster.start().await;
    comes(running.addr, "bert", Exact);
    comes(running.addr, "ernie", Exact);
    running.end().await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_confirmed_is_not_checked_again_and_all_else_is() {
    let at = tempfile::tempdir().unwrap();
    let path = at.path().join("journal");
    let wanted = directly(&demo(0.0));
    let honest: Arc<dyn RendererFactory> = Arc::new(Gate::before(Exact, 60));
    let workers = vec![("anna", honest.clone()), ("otto", honest)];
    let kept = begin(demo(1.0), &path, workers, |p| p.tiles_done >= 30, |kept| !kept.checked.is_empty()).await;
    assert!(kept.head.as_ref().unwrap().verified);
    let rendered = go_on(demo(1.0), &path).await;
    assert!(rendered.image == wanted && rendered.is_complete());
    assert_eq!(rendered.earlier.tiles, kept.tiles.len() as u64);
    let v = &rendered.verification;
    assert!(v.thrown_out.is_empty() && v.redone == 0);
    assert_eq!(v.checks.len(), 16 * 12, "every tile once, whichever run made it");
    let known = |name: &str| ["anna", "otto", "bert", "ernie"].contains(&name);
    assert!(v.checks.iter().all(|c| c.agreed && known(&c.maker)), "{:?}", v.checks);
}

#[tokio::test(flavor = "multi_thread")]
async fn lies_of_an_earlier_run_that_nobody_noticed_are_found_and_redone() {
    let at = tempfile::tempdir().unwrap();
    let path = at.path().join("journal");
    let wanted = directly(&demo(0.0));
    let liar: Arc<dyn RendererFactory> = Arc::new(Gate::before(Liar::once_in(5, Lie::Pixel), 40));
    let both = |kept: &Contents| kept.checked.len() == 2;
    let kept = begin(demo(NEXT_TO_NOTHING), &path, vec![("liar", liar)], |p| p.tiles_done >= 39, both).await;
    assert!(kept.thrown_out.is_empty() && both(&kept));
    let rendered = go_on(demo(1.0), &path).await;
    let v = &rendered.verification;
    assert_eq!(v.thrown_out, ["liar"]);
    assert!(v.redone > 0 && rendered.is_complete());
    assert!(rendered.image == wanted, "not a bit of the lie is left");
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_was_thrown_out_stays_out_and_what_it_made_does_not_return() {
    let at = tempfile::tempdir().unwrap();
    let path = at.path().join("journal");
    let wanted = directly(&demo(0.0));
    let (liar, honest): (Arc<dyn RendererFactory>, Arc<dyn RendererFactory>) =
        (Arc::new(Liar::once_in(12, Lie::Pixel)), Arc::new(Gate::before(Exact, 80)));
    let found = |p: &coordinator::Progress| p.workers.iter().any(|w| w.name == "liar" && w.left.is_some());
    let kept = begin(demo(1.0), &path, vec![("liar", liar), ("anna", honest)], found, |_| true).await;
    assert_eq!(kept.thrown_out.iter().map(|t| t.name.as_str()).collect::<Vec<_>>(), ["liar"]);
    // No pixel twice, what was taken back left out.
    let pixels = kept.pixels();
    assert!(pixels < 256 * 192);
    let rendered = go_on(demo(1.0), &path).await;
    assert!(rendered.image == wanted && rendered.is_complete());
    assert_eq!(rendered.verification.thrown_out, ["liar"], "the report knows of it still");
    assert_eq!(rendered.earlier.tiles, kept.tiles.len() as u64);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_adaptive_render_goes_on_through_its_passes() {
    let at = tempfile::tempdir().unwrap();
    let path = at.path().join("journal");
    let cluster = || {
        let mut cluster = demo(0.2);
        cluster.job.settings.sampling = Sampling::Adaptive;
        cluster.job.goal = Goal::Error(4.0 / 255.0);
        cluster
    };
    let mut quiet = cluster().workers(2, 1);
    quiet.job.verify = 0.0;
    let wanted = quiet.start().await.end().await.unwrap();
    let mut passes = 0;
    for tiles in [60, 240, 400, 240, 240] {
        let honest: Arc<dyn RendererFactory> = Arc::new(Gate::before(Exact, tiles));
        // Looks are checked whole, what earlier runs left unchecked of them before all else, and of the rest a part: so
        // many of those that are let through are tiles at least.
        let done = tiles as u64 / 8;
        let mut cluster = cluster();
        let journal = journal(&path).await;
        cluster.job.journal = Some(journal.clone());
        let mut running = cluster.start().await;
        for name in ["anna", "otto"] {
            let config = Config {
                threads: 1,
                name: name.into(),
                once: true,
                factory: honest.clone(),
                ..Config::new(running.addr.into())
            };
            tokio::spawn(worker::run(config, CancellationToken::new()));
        }
        // Whatever it comes to first: tiles of this run, or its end.
        let progress = &mut running.progress;
        let so = |p: &coordinator::Progress| p.workers.iter().map(|w| w.tiles).sum::<u64>() >= done;
        let _ = tokio::time::timeout(Duration::from_secs(60), progress.wait_for(so)).await.unwrap();
        running.cancel.cancel();
        let ended = running.end().await;
        drop(journal);
        passes = passes.max(Contents::read(&path).passed.len());
        if let Ok(rendered) = ended {
            assert!(rendered.image == wanted.image);
            return;
        }
    }
    let rendered = go_on(cluster(), &path).await;
    assert!(rendered.image == wanted.image && rendered.verification.thrown_out.is_empty());
    assert!(passes > 0, "it was ended in the first pass each time");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_render_does_not_go_on_with_other_words_about_verification() {
    let at = tempfile::tempdir().unwrap();
    let path = at.path().join("journal");
    let honest: Arc<dyn RendererFactory> = Arc::new(Gate::before(Exact, 20));
    begin(demo(0.0), &path, vec![("anna", honest)], |p| p.tiles_done >= 5, |_| true).await;
    let journal = journal(&path).await;
    let check = |verify: f64| journal.check(&demo(verify).job.head()).map_err(|e| e.to_string());
    assert_eq!(check(0.0), Ok(()));
    assert!(check(0.5).unwrap_err().contains("--verify (off there, on now)"));
}
