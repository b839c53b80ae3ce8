//! `coordinator render --farm`: a farm that stays renders, and all else is as if it were done here.

use std::sync::Arc;
use std::time::{Duration, Instant};

use coordinator::{Progress, Rendered, Verification, WorkerStats, is_final};
use tessera_core::scene::Scene;
use tessera_core::trace::RayCounts;
use tessera_proto::control::{self, Job};
use tessera_proto::convert::{Lease, printable};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tracing::{Span, info_span};
use worker::spans::SPANS;

use super::args::FarmFlags;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::farm::{Asking, Change, Client};
use super::jobs::verdict;
use super::options::Options;
use super::progress;
use super::runtime::unless_stopped;

/// Has the farm render `scene`, and gives what came.
pub(super) async fn rendered(
    options: &Options,
    scene: Arc<Scene>,
    (console, stop): (&Console, &CancellationToken),
    span: &Span,
) -> Result<Rendered, Failure> {
    let flags = FarmFlags { farm: options.farm.clone(), user_token: options.access.token_file.clone() };
    let mut client = unless_stopped(stop, Client::connect(&flags)).await??;
    let span = info_span!(target: SPANS, parent: span, "submit");
    let named = client.put_scene(scene).await?;
    let name = options.scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let asking = Asking {
        settings: options.settings,
        region: options.region,
        pixels: options.pixels,
        goal: options.goal(),
        tile: options.tile,
        verify: options.verify,
        name: &name,
        owner: None,
        priority: 0,
        group: "",
        deadline: None,
    };
    let job = client.submit(asking.spec(named), &span).await?;
    drop(span);
    let id = job.id;
    tracing::info!("submitted as job {id}");
    let (tell, watched) = watch::channel(Progress::default());
    let shown = tokio::spawn(progress::show(progress::Style::of(options.progress), watched, console.clone()));
    let ended = tokio::select! {
        ended = follow(&mut client, id, &tell) => ended,
        () = stop.cancelled() => {
            let mut client = client.clone();
            let cancelled = client.change(id, Change::Cancel).await;
            let what = if cancelled.is_ok() { "was cancelled" } else { "may go on" };
            Err(Failure::new(Exit::Interrupted, format!("interrupted; job {id} {what}")))
        }
    };
    drop(tell);
    let _ = shown.await;
    let job = ended?;
    match verdict(&job) {
        Ok(()) | Err(Failure { exit: Exit::TargetMissed, .. }) => {}
        Err(failure) => return Err(failure),
    }
    let picture = client.picture(id, false).await?;
    whole(options, &job, picture.image).ok_or_else(|| Failure::new(Exit::Failed, "the farm sends no sound result"))
}

/// Waits for a job's end; tells how far it is meanwhile. A farm that is started anew is found again.
async fn follow(client: &mut Client, id: u64, tell: &watch::Sender<Progress>) -> Result<Job, Failure> {
    let (mut last, mut lost) = (None::<Job>, None::<Instant>);
    loop {
        let mut watched = match client.watch(id).await {
            Ok(watched) => watched,
            Err(e) if lost.is_some_and(|at| at.elapsed() > Duration::from_secs(60)) || last.is_none() => return Err(e),
            Err(_) => {
                lost.get_or_insert_with(Instant::now);
                tokio::time::sleep(Duration::from_millis(500)).await;
                continue;
            }
        };
        lost = None;
        while let Ok(Some(job)) = watched.next().await {
            if let Some(p) = &job.progress {
                tell.send_replace(shown(p));
            }
            last = Some(job);
        }
        match &last {
            Some(job) if is_final(job.state()) => {
                return Ok(job.clone());
            }
            _ => tokio::time::sleep(Duration::from_millis(200)).await,
        }
    }
}

/// How far it is, as the bar shows it.
fn shown(p: &control::Progress) -> Progress {
    let worker = || WorkerStats { connected: true, ..WorkerStats::default() };
    Progress {
        pass: p.pass,
        is_look: p.is_look,
        share: p.share,
        remaining: p.remaining_us.map(Duration::from_micros),
        tiles_done: p.tiles_done,
        tiles_total: p.tiles_total,
        pixels_done: p.pixels_done,
        pixels_total: p.pixels_total,
        rays: p.rays.and_then(|r| RayCounts::try_from(r).ok()).unwrap_or_default(),
        workers: (0..p.workers.min(4096)).map(|_| worker()).collect(),
        elapsed: Duration::from_micros(p.elapsed_us),
        error: p.error,
        ..Progress::default()
    }
}

/// What the farm gave, as if it had been rendered here.
fn whole(options: &Options, job: &Job, image: coordinator::Pixels) -> Option<Rendered> {
    let result = job.result.as_ref()?;
    // What was added up over a whole picture is above a message's limit for one tile.
    let error = result.error.map(|e| {
        let sum = |s: Option<tessera_proto::wire::Sum>| {
            tessera_core::film::Sum(s.map_or(0, |s| (i128::from(s.high) << 64) | i128::from(s.low)))
        };
        tessera_core::film::ErrorEstimate {
            pixels: e.pixels,
            expected: sum(e.expected),
            audited: e.audited,
            squares: sum(e.squares),
            variance: sum(e.variance),
        }
    });
    let rays = result.rays?;
    Some(Rendered {
        region: options.region,
        image: coordinator::Film::Memory(image),
        done: vec![options.region],
        rays: RayCounts {
            camera: rays.camera,
            mirror: rays.mirror,
            shadow: rays.shadow,
            refined: rays.refined,
            unresolved: rays.unresolved,
        },
        earlier: coordinator::Earlier::default(),
        workers: result.workers.iter().map(stats).collect(),
        tiles: result.tiles,
        trace: Duration::from_micros(result.trace_us),
        error,
        target_met: result.target_met,
        pass: result.pass.and_then(pass),
        forecast: None,
        passes: result.passes,
        timed_out: result.timed_out,
        strangers: 0,
        verification: Verification { share: options.verify, ..Verification::default() },
    })
}

/// How closely the last pass looked; its region is the picture's, beyond what a lease may have.
fn pass(lease: tessera_proto::wire::Lease) -> Option<tessera_core::settings::Pass> {
    let region = Some(tessera_proto::wire::Region { x0: 0, y0: 0, x1: 1, y1: 1 });
    Lease::try_from(tessera_proto::wire::Lease { region, ..lease }).ok()?.pass
}

fn stats(w: &control::Worker) -> WorkerStats {
    WorkerStats {
        name: printable(&w.name),
        threads: w.threads,
        address: printable(&w.address),
        tiles: w.tiles,
        pixels: w.pixels,
        busy: Duration::from_micros(w.busy_us),
        lost: w.lost,
        verified: w.verified,
        ..WorkerStats::default()
    }
}
