//! A farm of up to tens of thousands of workers, simulated: the real scheduler, and tiles that cost what those of a real
//! render cost. Nothing is rendered.
//!
//! `cargo run --release -p tessera-tests --bin simulate` prints what a job of ten minutes comes to for 1 to 10,000
//! workers; `--help` tells what else can be asked. With `--plot FILE` it draws what `docs/figures.md` shows, with
//! `--measure` it measures the costs anew.

mod plot;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::{Parser, ValueEnum};
use coordinator::simulation::{CostMap, Outcome, Service, Setup, Trouble, simulate};
use tessera_tests::{costs, generate};

/// Scenes whose costs are known.
const SCENES: [&str; 3] = ["demo", "lights", "mirrors"];

/// A farm of up to tens of thousands of workers, simulated.
#[derive(Debug, Parser)]
struct Args {
    /// Workers, a run each.
    #[arg(long, value_delimiter = ',', default_values_t = [1, 10, 100, 1000, 10_000])]
    workers: Vec<u32>,
    /// Seconds that all workers would take for the job, were they busy from the first instant to the last.
    #[arg(long, value_delimiter = ',', default_values_t = [600.0])]
    job: Vec<f64>,
    /// Milliseconds to a worker and back, at least.
    #[arg(long, default_value_t = 0.1)]
    rtt: f64,
    /// And at most.
    #[arg(long, default_value_t = 0.5)]
    rtt_most: f64,
    /// What goes wrong.
    #[arg(long, value_enum, default_value_t = Luck::Calm)]
    luck: Luck,
    /// The scene whose costs tiles have: demo, lights, mirrors, or even for none's.
    #[arg(long, default_value = "demo")]
    costs: String,
    /// Width and height of the picture, rather than 2,000 pixels for a second of a worker, at most 16384x16384.
    #[arg(long, value_parser = size)]
    size: Option<(u32, u32)>,
    /// Microseconds that the coordinator takes for a message, beside the scheduler's own time, which is measured.
    #[arg(long, default_value_t = 40.0)]
    message_us: f64,
    /// Gigabits a second of the coordinator's line.
    #[arg(long, default_value_t = 10.0)]
    gbits: f64,
    /// Mebibytes of the scene.
    #[arg(long, default_value_t = 1.0)]
    scene_mib: f64,
    /// What decides everything that is drawn.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Draw efficiency against workers, as SVG.
    #[arg(long)]
    plot: Option<PathBuf>,
    /// Measure the scenes' costs on this machine, and write them where the tests find them.
    #[arg(long)]
    measure: bool,
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Luck {
    /// Nothing.
    Calm,
    /// Of all workers 10 % come late, 2 % become slow, 2 % are killed, 2 % are cut off; 0.5 % of messages are resent.
    Bad,
}

impl Luck {
    fn trouble(self) -> Trouble {
        match self {
            Self::Calm => Trouble::default(),
            Self::Bad => Trouble { late: 0.1, slow: 0.02, killed: 0.02, cut: 0.02, resent: 0.005 },
        }
    }
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = text.split_once('x').ok_or("as 1920x1080")?;
    let number = |t: &str| t.parse().ok().filter(|n| (1..=65_536).contains(n)).ok_or("1 to 65536");
    Ok((number(width)?, number(height)?))
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), String> {
    if args.measure {
        return measure();
    }
    let map = if args.costs == "even" { CostMap::even() } else { costs::read(&args.costs)? };
    if let Some(path) = &args.plot {
        let svg = plot::draw(&map);
        return std::fs::write(path, svg).map_err(|e| format!("{}: {e}", path.display()));
    }
    println!("the dearest part of the picture is {:.1} times as dear as it is on the whole", map.dearest());
    heading();
    for job in &args.job {
        for workers in &args.workers {
            let usual = Setup::new(*workers, Duration::from_secs_f64(job.max(1e-3)), map.clone());
            let setup = Setup {
                seed: args.seed,
                picture: args.size.unwrap_or(usual.picture),
                round_trip: (ms(args.rtt), ms(args.rtt.max(args.rtt_most))),
                trouble: args.luck.trouble(),
                scene: (args.scene_mib * 1048576.0) as u64,
                service: Service {
                    message: Duration::from_secs_f64(args.message_us.max(0.0) / 1e6),
                    measured: true,
                    line: args.gbits.max(1e-6) * 1.25e8,
                    ..Service::default()
                },
                ..usual
            };
            let began = Instant::now();
            let outcome = simulate(&setup);
            tell(&setup, &outcome, began.elapsed());
        }
    }
    Ok(())
}

fn ms(ms: f64) -> Duration {
    Duration::from_secs_f64(ms.max(0.0) / 1e3)
}

fn heading() {
    println!(
        "{:>6} {:>7} {:>9} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>9} {:>9} {:>8} {:>6} {:>8} {:>8} {:>8} {:>5} {:>6}",
        "job s",
        "workers",
        "took s",
        "useful",
        "wasted",
        "starts",
        "waits",
        "ends",
        "tail",
        "tiles",
        "tile ms",
        "GB in",
        "load",
        "wait ms",
        "sched us",
        "most ms",
        "cut",
        "run s"
    );
}

fn tell(setup: &Setup, o: &Outcome, took: Duration) {
    let percent = |share: f64| format!("{:.2}", 100.0 * share);
    let all = o.took.as_secs_f64() * f64::from(setup.workers) * o.efficiency;
    println!(
        "{:>6} {:>7} {:>9.2} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6.3} {:>9} {:>9.1} {:>8.2} {:>6} {:>8.1} {:>8.2} {:>8.2} {:>5} {:>6.1}",
        setup.job.as_secs_f64(),
        setup.workers,
        o.took.as_secs_f64(),
        percent(o.efficiency),
        percent(o.wasted),
        percent(o.starting),
        percent(o.waiting),
        percent(o.ending()),
        o.tail(),
        o.tiles,
        1e3 * all / o.tiles.max(1) as f64,
        o.bytes.0 as f64 / 1e9,
        percent(o.load),
        1e3 * o.longest_wait.as_secs_f64(),
        1e6 * o.scheduler.as_secs_f64(),
        1e3 * o.scheduler_longest.as_secs_f64(),
        o.cut_off,
        took.as_secs_f64(),
    );
}

fn measure() -> Result<(), String> {
    for scene in SCENES {
        let document = match scene {
            "demo" => generate::demo(),
            "lights" => generate::lights(1000, 100),
            _ => generate::mirrors(),
        };
        let text = costs::measure(&document, (1280, 960))?;
        let path = costs::file(scene);
        std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("{}: the dearest part {:.1} times the mean", path.display(), costs::read(scene)?.dearest());
    }
    Ok(())
}
