//! Farms that render to a target, or until time is up.

#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::time::Duration;

use coordinator::{Goal, Pixels, Rendered};
use rustix::process::Signal;
use tessera_core::settings::Sampling;
use tessera_tests::cluster::Cluster;
use tessera_tests::generate;
use tessera_tests::process::Process;
use tessera_tests::program::program;

fn adaptive(goal: Goal) -> Cluster {
    let mut cluster = Cluster::of(generate::demo().scene().unwrap()).size(130, 97);
    cluster.job.settings.sampling = Sampling::Adaptive;
    cluster.job.goal = goal;
    cluster
}

fn bits(rendered: &Rendered) -> Vec<[u32; 3]> {
    let Some(Pixels::F32(pixels)) = rendered.image.pixels() else { panic!("not floats") };
    pixels.iter().map(|p| p.map(f32::to_bits)).collect()
}

#[test]
fn a_target_gives_the_same_picture_whoever_renders() {
    for goal in [Goal::Error(1.0 / 255.0), Goal::Error(0.25 / 255.0)] {
        let wanted = adaptive(goal).workers(1, 1).tile(64).render().unwrap();
        assert!(wanted.is_complete() && wanted.error.is_some());
        for (workers, tile) in [(2, 16), (3, 24), (2, 5)] {
            let got = adaptive(goal).workers(workers, 1).tile(tile).render().unwrap();
            assert_eq!((got.pass, got.passes), (wanted.pass, wanted.passes), "{goal:?}");
            assert_eq!(got.error, wanted.error, "{goal:?}: {workers} workers, tiles of {tile}");
            assert!(bits(&got) == bits(&wanted), "{goal:?}: {workers} workers, tiles of {tile}");
        }
        let by_cost = adaptive(goal).render().unwrap();
        assert!(bits(&by_cost) == bits(&wanted), "{goal:?}: tiles by cost");
    }
}

#[test]
fn a_looser_target_takes_fewer_rays_and_says_what_it_reached() {
    let [loose, tight] = [2.0, 0.4].map(|steps| {
        let rendered = adaptive(Goal::Error(steps / 255.0)).render().unwrap();
        let got = 255.0 * rendered.error.unwrap().rmse();
        assert!(got <= steps && rendered.target_met == Some(true), "{got} for {steps}");
        rendered
    });
    assert!(loose.rays.camera < tight.rays.camera);
    assert!(loose.error.unwrap().rmse() > tight.error.unwrap().rmse());
}

#[tokio::test]
async fn a_worker_killed_between_passes_changes_nothing() {
    let mut cluster = adaptive(Goal::Error(0.5 / 255.0)).workers(0, 1).nervous();
    let wanted = {
        let cluster = adaptive(Goal::Error(0.5 / 255.0));
        tokio::task::spawn_blocking(move || cluster.render().unwrap()).await.unwrap()
    };
    cluster.job.patience = Duration::from_secs(30).into();
    let mut running = cluster.tile(16).start().await;
    let addr = running.addr.to_string();
    let victim = Process::start("worker", &["--connect", &addr, "--threads", "1", "--name", "victim"]);
    running.until(|p| p.workers.first().is_some_and(|w| w.tiles > 0)).await;
    victim.signal(Signal::KILL);
    running.until(|p| !p.workers[0].connected).await;
    let _heir = Process::start("worker", &["--connect", &addr, "--threads", "1", "--name", "heir", "--once"]);
    let got = running.end().await.unwrap();
    assert_eq!((got.error, got.pass), (wanted.error, wanted.pass));
    assert!(bits(&got) == bits(&wanted));
}

/// How nearly in time is a matter for a machine that does nothing else; this is about not waiting
/// for the dead.
#[tokio::test]
async fn a_time_limit_is_kept_though_a_worker_dies() {
    let limit = Duration::from_secs(4);
    let mut cluster = Cluster::of(generate::lights(200, 40).scene().unwrap()).size(640, 480).workers(0, 1);
    cluster.job.settings.sampling = Sampling::Adaptive;
    cluster.job.goal = Goal::Time { limit, error: Some(1e-9) };
    // Built before the clock runs.
    let _ = program("worker");
    let begin = tokio::time::Instant::now();
    let mut running = cluster.start().await;
    let addr = running.addr.to_string();
    let worker = |name| Process::start("worker", &["--connect", &addr, "--threads", "1", "--name", name]);
    let (victim, _other) = (worker("victim"), worker("other"));
    running.until(|p| p.workers.iter().any(|w| w.name == "victim" && w.tiles > 0)).await;
    victim.signal(Signal::KILL);
    let rendered = running.end().await.unwrap();
    let took = begin.elapsed();
    assert!(rendered.timed_out);
    assert!(took < 2 * limit, "{took:?} of {limit:?}");
    println!("{took:?} of {limit:?}");
}
