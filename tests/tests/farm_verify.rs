//! Workers whose pixels are not the scene's, and how they are found.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::net::SocketAddr;
use std::sync::Arc;

use coordinator::{Goal, Pixels, Rendered};
use tessera_core::settings::Sampling;
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::cluster::Cluster;
use tessera_tests::generate;
use tessera_tests::renderers::{Liar, Lie};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use worker::{Config, Exact, Left, RendererFactory, WorkerError};

fn demo() -> Cluster {
    Cluster::of(generate::demo().scene().unwrap()).size(256, 192).tile(16)
}

/// As good as a quick look needs.
fn adaptive(cluster: &mut Cluster) {
    cluster.job.settings.sampling = Sampling::Adaptive;
    cluster.job.goal = Goal::Error(4.0 / 255.0);
}

/// What core renders without any farm.
fn directly(cluster: &Cluster) -> Pixels {
    let prepared = Arc::new(PreparedScene::build(cluster.job.scene.scene().clone()));
    Pixels::F32(Tracer::new(prepared, cluster.job.settings).unwrap().render(cluster.job.region).0.pixels)
}

fn comes(
    addr: SocketAddr,
    name: &str,
    factory: impl RendererFactory + 'static,
) -> JoinHandle<Result<Left, WorkerError>> {
    let config =
        Config { threads: 1, name: name.into(), once: true, factory: Arc::new(factory), ..Config::new(addr.into()) };
    tokio::spawn(worker::run(config, CancellationToken::new()))
}

/// That `liar` was found and nobody else, and that nothing of the lie is left.
fn is_found(rendered: &Rendered, wanted: &Pixels, liar: &str) {
    let v = &rendered.verification;
    assert_eq!(v.thrown_out, [liar]);
    assert!(rendered.is_complete() && v.redone > 0);
    assert!(rendered.image == *wanted, "not a bit of the lie is left");
    let disagreed: Vec<_> = v.checks.iter().filter(|c| !c.agreed).collect();
    assert!(disagreed.iter().any(|c| c.maker == liar || c.checker.as_deref() == Some(liar)), "{disagreed:?}");
    let stats = rendered.workers.iter().find(|w| w.name == liar).unwrap();
    assert!(stats.left.as_ref().unwrap().contains("not what the scene shows"), "{stats:?}");
    let area: u64 = rendered.workers.iter().map(|w| w.pixels).sum();
    assert_eq!(area, rendered.region.area(), "figures are of what is in the picture");
}

#[tokio::test]
async fn a_liar_is_found_named_and_thrown_out_and_its_tiles_are_rendered_again() {
    let mut cluster = demo().workers(0, 1);
    cluster.job.verify = 1.0;
    let wanted = directly(&cluster);
    let mut running = cluster.start().await;
    let addr = running.addr;
    let liar = comes(addr, "liar", Liar::once_in(50, Lie::Pixel));
    running.until(|p| p.workers.len() == 1).await;
    let honest = [comes(addr, "bert", Exact), comes(addr, "ernie", Exact)];
    let rendered = running.end().await.unwrap();
    is_found(&rendered, &wanted, "liar");
    assert!(matches!(liar.await.unwrap(), Err(WorkerError::Refused(_))), "it is told, and not let in again");
    for worker in honest {
        assert_eq!(worker.await.unwrap().unwrap(), Left::Finished);
    }
}

#[tokio::test]
async fn a_liar_of_the_same_process_is_found_too() {
    let mut cluster = demo().workers(1, 1).factory(Liar::once_in(50, Lie::Pixel));
    cluster.job.verify = 1.0;
    let wanted = directly(&cluster);
    let mut running = cluster.start().await;
    running.until(|p| p.workers.len() == 1).await;
    comes(running.addr, "bert", Exact);
    is_found(&running.end().await.unwrap(), &wanted, "local-1");
}

#[tokio::test]
async fn a_liar_about_the_error_is_found_too() {
    let mut cluster = demo().workers(0, 1);
    adaptive(&mut cluster);
    let wanted = cluster.clone().workers(2, 1).start().await.end().await.unwrap().image;
    cluster.job.verify = 1.0;
    let mut running = cluster.start().await;
    comes(running.addr, "liar", Liar::once_in(1, Lie::Estimate));
    running.until(|p| p.workers.len() == 1).await;
    comes(running.addr, "bert", Exact);
    let rendered = running.end().await.unwrap();
    assert_eq!(rendered.verification.thrown_out, ["liar"]);
    assert!(rendered.image == wanted);
}

#[tokio::test]
async fn one_worker_alone_is_held_against_the_coordinators_own_core() {
    let mut cluster = demo().workers(0, 1);
    cluster.job.verify = 0.1;
    let wanted = directly(&cluster);
    let running = cluster.clone().start().await;
    comes(running.addr, "alone", Exact);
    let rendered = running.end().await.unwrap();
    assert!(rendered.image == wanted);
    let v = &rendered.verification;
    assert!(v.thrown_out.is_empty() && v.checks.len() >= 2, "{v:?}");
    assert!(v.checks.iter().all(|c| c.agreed && c.checker.is_none() && c.maker == "alone"));
    // Alone, and a liar: whoever comes after it does all of it.
    cluster.job.verify = 1.0;
    let mut running = cluster.start().await;
    comes(running.addr, "liar", Liar::once_in(20, Lie::Pixel));
    running.until(|p| p.workers.first().is_some_and(|w| w.left.is_some())).await;
    comes(running.addr, "bert", Exact);
    is_found(&running.end().await.unwrap(), &wanted, "liar");
}

#[tokio::test]
async fn honest_workers_agree_in_every_format_and_pass_and_nothing_is_rendered_thrice() {
    for is_adaptive in [false, true] {
        for pixels in [coordinator::PixelFormat::Rgb8, coordinator::PixelFormat::F32] {
            let mut cluster = demo().workers(2, 1);
            if is_adaptive {
                adaptive(&mut cluster);
            }
            (cluster.job.pixels, cluster.job.verify) = (pixels, 1.0);
            let rendered = cluster.start().await.end().await.unwrap();
            let v = &rendered.verification;
            assert!(rendered.is_complete() && v.thrown_out.is_empty() && v.redone == 0, "{v:?}");
            let tiles = 16 * 12;
            assert!(if is_adaptive { v.checks.len() >= tiles } else { v.checks.len() == tiles }, "every tile, once");
            assert!(v.checks.iter().all(|c| c.agreed && c.checker.as_ref() != Some(&c.maker)));
        }
    }
}
