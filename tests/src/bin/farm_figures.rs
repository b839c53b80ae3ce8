//! Measures a farm that stays: `cargo run --release -p tessera-tests --bin farm_figures`, beside the programs.
//!
//! What is told: from a submission to the first tile leased; what it costs a worker to go from one scene to another
//! that it has, too; what it costs a render to be watched; memory and time of a submission with 10,000 jobs queued.

#![expect(clippy::unwrap_used, reason = "a measurement that cannot go on may stop")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;
use tessera_proto::control::control_client::ControlClient;
use tessera_proto::control::{JobName, Spec, State};
use tessera_proto::wire::Ready;
use tessera_proto::wire::coordinator_message::Kind as Hear;
use tessera_proto::wire::worker_message::Kind as Say;
use tessera_tests::fake::{Fake, registration};
use tessera_tests::loopback;
use tessera_tests::process::resident;
use tessera_tests::program::scene;
use tessera_tests::web::http;
use tonic::transport::{Channel, Endpoint};

/// Jobs of each kind that are timed.
const TIMES: u64 = 30;
/// Jobs that wait.
const QUEUED: u64 = 10_000;

/// A program that ends with this.
struct Ending(Child);

impl Drop for Ending {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn program(name: &str) -> PathBuf {
    std::env::current_exe().unwrap().with_file_name(name)
}

fn start(name: &str, args: &[&str]) -> Ending {
    let mut command = Command::new(program(name));
    command.args(args).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    Ending(command.spawn().expect("build the programs first: cargo build --release --workspace --bins"))
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times[times.len() / 2]
}

fn ms(d: Duration) -> f64 {
    1e3 * d.as_secs_f64()
}

/// A farm, and a client of it.
struct Farm {
    serve: Ending,
    folder: tempfile::TempDir,
    at: String,
    calls: ControlClient<Channel>,
    /// Makes every job another.
    next: u32,
}

impl Farm {
    async fn start() -> Self {
        let (folder, at) = (tempfile::tempdir().unwrap(), loopback::free().to_string());
        let state = folder.path().join("state").display().to_string();
        let serve = start("coordinator", &["serve", "--state", &state, "--listen", &at, "--http", "none"]);
        let endpoint = Endpoint::from_shared(format!("http://{at}")).unwrap();
        let began = Instant::now();
        let channel = loop {
            match endpoint.connect().await {
                Ok(channel) => break channel,
                Err(e) => assert!(began.elapsed() < Duration::from_secs(60), "{e}"),
            }
        };
        Self { serve, folder, at, calls: ControlClient::new(channel), next: 20 }
    }

    /// What the command submits; the job itself is cancelled.
    async fn spec(&mut self, name: &str) -> Spec {
        let path = scene(name).display().to_string();
        let args = ["submit", &path, "--size", "32x24", "--samples", "1", "--farm", &self.at];
        let told = Command::new(program("coordinator")).args(args).output().unwrap();
        let id = String::from_utf8(told.stdout).unwrap().trim().parse().unwrap();
        let job = self.calls.get_job(JobName { id }).await.unwrap().into_inner();
        let _ = self.calls.cancel(JobName { id }).await;
        job.spec.unwrap()
    }

    /// The same, and yet another job.
    fn another(&mut self, spec: &Spec) -> Spec {
        self.next += 1;
        let mut spec = spec.clone();
        spec.settings.as_mut().unwrap().max_depth = self.next;
        spec
    }

    /// Submits a job and waits for its end.
    async fn done(&mut self, spec: &Spec) -> Duration {
        let spec = self.another(spec);
        let began = Instant::now();
        let job = self.calls.submit(spec).await.unwrap().into_inner();
        let mut watched = self.calls.watch_job(JobName { id: job.id }).await.unwrap().into_inner();
        let mut last = job;
        while let Some(job) = watched.message().await.unwrap() {
            last = job;
        }
        assert_eq!(last.state(), State::Done, "{last:?}");
        // The farm looks ten times a second: what it wrote itself is exact.
        let own = Duration::from_millis(last.ended_ms - last.submitted_ms);
        own.min(began.elapsed())
    }
}

async fn first_lease() {
    let mut farm = Farm::start().await;
    let spec = farm.spec("demo.xml").await;
    let mut fake = Fake::register(farm.at.parse().unwrap(), registration("fake")).await.unwrap();
    let mut times = Vec::new();
    for _ in 0..TIMES {
        let spec = farm.another(&spec);
        let began = Instant::now();
        let id = farm.calls.submit(spec).await.unwrap().into_inner().id;
        loop {
            match fake.hear().await.unwrap().unwrap() {
                Hear::Job(job) => fake.say(Say::Ready(Ready { job: job.job })).await,
                Hear::Lease(_) => break,
                _ => {}
            }
        }
        times.push(began.elapsed());
        farm.calls.cancel(JobName { id }).await.unwrap();
        // Until the farm has let go of it.
        tokio::time::sleep(Duration::from_millis(300)).await;
        while tokio::time::timeout(Duration::from_millis(50), fake.hear()).await.is_ok() {}
    }
    let most = times.iter().max().copied().unwrap();
    println!(
        "submission to first tile leased: median {:.1} ms, at most {:.1} ms (goal 50)",
        ms(median(times)),
        ms(most)
    );
}

async fn switching() {
    let mut farm = Farm::start().await;
    let (one, other) = (farm.spec("demo.xml").await, farm.spec("mirrors.xml").await);
    let _worker = start("worker", &["--connect", &farm.at, "--threads", "1"]);
    farm.done(&one).await;
    farm.done(&other).await;
    let (mut same, mut switched) = (Vec::new(), Vec::new());
    for n in 0..TIMES {
        // Both scenes as often either way: one, one, other, other.
        let scene = if n % 2 == 0 { &one } else { &other };
        switched.push(farm.done(scene).await);
        same.push(farm.done(scene).await);
    }
    let (same, switched) = (median(same), median(switched));
    println!(
        "a job of one tile: {:.1} ms after one of the same scene, {:.1} ms after one of another (goal 10 ms more)",
        ms(same),
        ms(switched)
    );
}

/// Looks at a render as the page does.
fn look(at: &str, stop: &AtomicBool) -> u64 {
    let mut pictures = 0;
    while !stop.load(Ordering::Relaxed) {
        if std::net::TcpStream::connect(at).is_err() {
            std::thread::sleep(Duration::from_millis(20));
            continue;
        }
        let looked = std::panic::catch_unwind(|| {
            let _ = http(at, "GET", "/api/v1/events?job=1", "");
            http(at, "GET", "/api/v1/jobs/1/picture.png?width=1000&height=750", "").status
        });
        pictures += u64::from(matches!(looked, Ok(200)));
        std::thread::sleep(Duration::from_millis(200));
    }
    pictures
}

fn watching() {
    let folder = tempfile::tempdir().unwrap();
    let demo = scene("demo.xml").display().to_string();
    let render = |watched: bool| {
        let (at, stop) = (loopback::free().to_string(), Arc::new(AtomicBool::new(false)));
        let http = if watched { at.clone() } else { "none".into() };
        let args = ["render", &demo, "-o", "x.png", "--size", "1600x1200", "--samples", "64", "--progress", "none"];
        let mut command = Command::new(program("coordinator"));
        command.current_dir(folder.path()).args(args).args(["--report", "-", "--http", &http]).stderr(Stdio::null());
        let watcher = watched.then(|| {
            let stop = stop.clone();
            std::thread::spawn(move || look(&at, &stop))
        });
        let out = command.output().unwrap();
        stop.store(true, Ordering::Relaxed);
        let pictures = watcher.map_or(0, |w| w.join().unwrap());
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        (report["seconds"]["trace"].as_f64().unwrap(), pictures)
    };
    std::panic::set_hook(Box::new(|_| {}));
    let (mut alone, mut seen, mut pictures) = (f64::MAX, f64::MAX, 0);
    for _ in 0..4 {
        alone = alone.min(render(false).0);
        let (seconds, looked) = render(true);
        (seen, pictures) = (seen.min(seconds), pictures.max(looked));
    }
    println!(
        "a render alone {alone:.2} s, watched {seen:.2} s ({pictures} pictures): {:+.1} % (goal 2)",
        100.0 * (seen / alone - 1.0)
    );
}

async fn queued() {
    let mut farm = Farm::start().await;
    let spec = farm.spec("demo.xml").await;
    let before = resident(farm.serve.0.id());
    let began = Instant::now();
    let mut calls = tokio::task::JoinSet::new();
    for n in 0..QUEUED {
        let (mut client, mut spec) = (farm.calls.clone(), farm.another(&spec));
        (spec.name, spec.owner) = (format!("frame {n:05}"), format!("owner {}", n % 5));
        calls.spawn(async move { client.submit(spec).await.map(drop) });
        while calls.len() >= 128 {
            calls.join_next().await.unwrap().unwrap().unwrap();
        }
    }
    while let Some(called) = calls.join_next().await {
        called.unwrap().unwrap();
    }
    let took = began.elapsed();
    let mut times = Vec::new();
    for _ in 0..100 {
        let spec = farm.another(&spec);
        let began = Instant::now();
        farm.calls.submit(spec).await.unwrap();
        times.push(began.elapsed());
    }
    let each = resident(farm.serve.0.id()).saturating_sub(before) as f64 / QUEUED as f64;
    println!(
        "{QUEUED} jobs queued in {:.1} s: {:.2} KiB each (goal 2), and one more takes {:.1} ms",
        took.as_secs_f64(),
        each / 1024.0,
        ms(median(times))
    );
    let size: u64 = fs::metadata(Path::new(farm.folder.path()).join("state/queue.redb")).unwrap().len();
    println!("their database: {:.1} MiB", size as f64 / f64::from(1 << 20));
}

fn main() {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let wants = |name: &str| wanted.is_empty() || wanted.iter().any(|w| w == name);
    if wants("lease") {
        runtime.block_on(first_lease());
    }
    if wants("switch") {
        runtime.block_on(switching());
    }
    if wants("watch") {
        watching();
    }
    if wants("queue") {
        runtime.block_on(queued());
    }
}
