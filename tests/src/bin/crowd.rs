//! A real coordinator and thousands of workers that render nothing: what it costs to keep them busy.
//!
//! `crowd --workers 2000 --tile-ms 100` renders a black picture over loopback. Each worker holds a tile for that long and
//! sends black pixels. Told are the share of the time that workers had a tile, and the coordinator's processor time a tile.

use std::collections::VecDeque;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use clap::Parser;
use tessera_proto::wire::coordinator_message::Kind as Hear;
use tessera_proto::wire::worker_message::Kind as Say;
use tessera_proto::wire::{BeatRequest, Lease, RayCounts, TileDone};
use tessera_tests::fake::Fake;
use tessera_tests::loopback;
use tessera_tests::process::resident;
use tessera_tests::program::{program, scene};

/// Pixels along a tile's edge.
const EDGE: u64 = 16;
/// Workers that connect at a time.
const AT_ONCE: usize = 50;

/// A real coordinator and thousands of workers that render nothing.
#[derive(Debug, Parser)]
struct Args {
    /// Workers.
    #[arg(long, default_value_t = 2000)]
    workers: u64,
    /// Milliseconds that a tile takes.
    #[arg(long, default_value_t = 100)]
    tile_ms: u64,
    /// Seconds that the render should take, were everyone busy.
    #[arg(long, default_value_t = 10)]
    seconds: u64,
}

/// What all workers did.
#[derive(Debug, Default)]
struct Done {
    tiles: AtomicU64,
    lost: AtomicU64,
}

#[tokio::main]
async fn main() -> ExitCode {
    match run(&Args::parse()).await {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::FAILURE
        }
    }
}

async fn run(args: &Args) -> Result<(), String> {
    coordinator::open_files::raise();
    // Where tiles take no time, as many as ten thousand workers' would be.
    let a_second = (args.workers * 1000).checked_div(args.tile_ms).unwrap_or(100_000);
    let tiles = a_second * args.seconds;
    let across = (tiles as f64).sqrt().ceil() as u64;
    let down = tiles.div_ceil(across);
    let at = tempfile::tempdir().map_err(|e| e.to_string())?;
    let free = loopback::free();
    let mut farm = Command::new(program("coordinator"))
        .arg("render")
        .arg(scene("demo.xml"))
        .args(["-o", "a.png", "--workers", "0", "--samples", "1", "--journal", "none", "--progress", "none"])
        .args(["--tile", &EDGE.to_string(), "--size", &format!("{}x{}", across * EDGE, down * EDGE)])
        .args(["--listen", &free.to_string()])
        .current_dir(at.path())
        .stdout(Stdio::null())
        .spawn()
        .map_err(|e| e.to_string())?;
    while tokio::net::TcpStream::connect(free).await.is_err() {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let (began, alone) = (Instant::now(), resident(farm.id()));
    let done = Arc::new(Done::default());
    let mut workers = Vec::new();
    let places = Arc::new(tokio::sync::Semaphore::new(AT_ONCE));
    for n in 0..args.workers {
        let place = places.clone().acquire_owned().await.map_err(|e| e.to_string())?;
        let (done, time) = (done.clone(), Duration::from_millis(args.tile_ms));
        workers.push(tokio::spawn(async move {
            let fake = Fake::ready(free, &format!("fake-{n}")).await;
            drop(place);
            work(fake, time, &done).await;
        }));
    }
    let connected = began.elapsed();
    let (cpu_before, tiles_before, at_before) = (cpu(farm.id()), done.tiles.load(Ordering::Relaxed), Instant::now());
    // The most that it holds while all are there, without the picture, three bytes a pixel.
    let picture = 3 * EDGE * EDGE * across * down;
    let (process, over) = (farm.id(), Arc::new(AtomicBool::new(false)));
    let watched = tokio::spawn({
        let over = over.clone();
        async move {
            let mut most = 0;
            while !over.load(Ordering::Relaxed) {
                most = most.max(resident(process));
                tokio::time::sleep(Duration::from_millis(200)).await;
            }
            most
        }
    });
    for worker in workers {
        worker.await.map_err(|e| e.to_string())?;
    }
    let wall = at_before.elapsed();
    over.store(true, Ordering::Relaxed);
    let memory = watched.await.map_err(|e| e.to_string())?.saturating_sub(alone + picture);
    // Its time is told as long as it is there: it writes the picture now.
    let cpu = cpu(farm.id()) - cpu_before;
    let rendered = done.tiles.load(Ordering::Relaxed) - tiles_before;
    let status = farm.wait().map_err(|e| e.to_string())?;
    let seconds = wall.as_secs_f64();
    println!("{} workers were there after {:.1} s", args.workers, connected.as_secs_f64());
    println!("the coordinator holds {:.0} KiB for each", memory as f64 / 1024.0 / args.workers as f64);
    println!("{rendered} tiles in {seconds:.2} s, {:.0} a second", rendered as f64 / seconds);
    if args.tile_ms > 0 {
        let busy = rendered as f64 * args.tile_ms as f64 / 1e3 / (args.workers as f64 * seconds);
        println!("workers were busy {:.1} % of the time", 100.0 * busy);
    }
    println!("the coordinator took {:.1} µs of processor time a tile", 1e6 * cpu / rendered as f64);
    println!("{} sessions were ended early; the coordinator: {status}", done.lost.load(Ordering::Relaxed));
    Ok(())
}

/// Does what a worker of one thread does, but for the pixels.
async fn work(mut fake: Fake, time: Duration, done: &Done) {
    // Beats as a worker does, rather than as tests want it.
    fake.falls_silent();
    let (mut beats, session) = (fake.client.clone(), fake.welcome.session);
    let heartbeat = tokio::spawn(async move {
        while beats.beat(BeatRequest { session }).await.is_ok() {
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    });
    // It hears while it is at work: the next tile begins when the one before it ends, however late that is told.
    let mut leases = VecDeque::<(Lease, tokio::time::Instant)>::new();
    let mut free_at = tokio::time::Instant::now();
    loop {
        let ends_at = leases.front().map(|(_, came)| free_at.max(*came) + time);
        let rendered = async {
            match ends_at {
                Some(_) if time.is_zero() => {}
                Some(at) => tokio::time::sleep_until(at).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            () = rendered => {
                if let (Some((lease, _)), Some(at)) = (leases.pop_front(), ends_at) {
                    free_at = at;
                    done.tiles.fetch_add(1, Ordering::Relaxed);
                    fake.say(answer(&lease, time)).await;
                }
            }
            heard = fake.hear() => match heard {
                Ok(Some(Hear::Lease(lease))) => leases.push_back((lease, tokio::time::Instant::now())),
                // What is revoked was begun already.
                Ok(Some(Hear::Revoke(_))) => {}
                Ok(Some(_) | None) => break,
                Err(_) => {
                    done.lost.fetch_add(1, Ordering::Relaxed);
                    break;
                }
            },
        }
    }
    heartbeat.abort();
}

fn answer(lease: &Lease, time: Duration) -> Say {
    let pixels = lease.region.map_or(0, |r| (r.x1 - r.x0) as usize * (r.y1 - r.y0) as usize);
    Say::TileDone(TileDone {
        lease: lease.lease,
        attempt: lease.attempt,
        pixels: vec![0; 3 * pixels].into(),
        packed: 0,
        rays: Some(RayCounts { camera: pixels as u64, ..RayCounts::default() }),
        busy_us: time.as_micros() as u64,
        idle_us: 0,
        error: None,
    })
}

/// Seconds of processor time that a process has taken.
fn cpu(process: u32) -> f64 {
    let stat = std::fs::read_to_string(Path::new("/proc").join(process.to_string()).join("stat")).unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(") ").next().unwrap_or_default().split(' ').collect();
    let ticks = |at: usize| fields.get(at).and_then(|f| f.parse::<f64>().ok()).unwrap_or(0.0);
    // User and system time, in hundredths of a second.
    (ticks(11) + ticks(12)) / 100.0
}
