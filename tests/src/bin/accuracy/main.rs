//! Measures what errors cost in seconds, and whether they are told as they are.
//!
//! ```text
//! scene ─▶ truth (kept in a folder) ─▶ rounds: every setting once a round, by a farm ─▶ medians ─▶ tables
//! ```
//! Uniform sampling, by grids and by scrambled points, is what adaptive pictures are compared with: seconds to an
//! error are those between the two settings measured whose errors lie around it, on logarithmic axes.

mod curve;
mod povray;
mod run;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use tessera_core::settings::{Quality, Sampling, Settings, Transfer, View};
use tessera_tests::truth::{Truth, rmse};

use curve::{Curve, median};
use run::{Picture, Scene, Setting};

/// Any error: all this program does with one is to say it.
type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

const MORE: &str = "\
Times are of tracing, farm included, by two workers in this process; medians of rounds in
which every setting has its turn. Errors are of linear light, in 8-bit steps.

Examples:
  accuracy demo.xml terrain64.xml
  accuracy --references refs --runs 5 demo.xml
  accuracy --size 320x240 --no-reference-quality town.xml";

/// Seconds to true errors, against uniform sampling, and true against told errors.
#[derive(Debug, Parser)]
#[command(name = "accuracy", after_help = MORE, max_term_width = 100)]
struct Args {
    /// Scenes
    #[arg(value_name = "SCENE", required = true)]
    scenes: Vec<PathBuf>,
    /// Folder where references are kept
    #[arg(long, value_name = "DIR", default_value = "target/references")]
    references: PathBuf,
    /// Samples a pixel of a reference
    #[arg(long, value_name = "N", default_value = "2048")]
    samples: u32,
    /// Pixels across and down
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size)]
    size: (u32, u32),
    /// Rays in a path at most
    #[arg(long, value_name = "D", default_value = "6")]
    max_depth: u32,
    /// Threads of all workers together
    #[arg(long, value_name = "T", default_value = "2")]
    threads: usize,
    /// Rounds
    #[arg(long, value_name = "K", default_value = "3")]
    runs: usize,
    /// Do not render at --quality reference, which takes longest
    #[arg(long)]
    no_reference_quality: bool,
}

fn size(text: &str) -> std::result::Result<(u32, u32), String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parsed.ok_or_else(|| "expected WIDTHxHEIGHT".into())
}

/// Errors that seconds are told to.
const ERRORS: [f64; 4] = [2.0, 1.0, 0.5, 0.25];
/// Errors asked for.
const TARGETS: [f64; 7] = [4.0, 2.0, 1.0, 0.5, 0.25, 0.12, 0.05];
/// Uniform samples, as points along a pixel's edge.
const EDGES: [u32; 11] = [1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20];

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<()> {
    std::fs::create_dir_all(&args.references)?;
    println!(
        "| scene | to an RMSE of 2, 1, 0.5, 0.25: seconds (of uniform sampling's) | rays/s | true ÷ told | POV-Ray |"
    );
    println!("| --- | --- | --- | --- | --- |");
    for path in &args.scenes {
        println!("{}", measure(args, path)?);
    }
    Ok(())
}

/// A setting, its error, and the times and rays of its runs.
struct Tried {
    setting: Setting,
    error: f64,
    told: Option<f64>,
    rays: u64,
    seconds: Vec<f64>,
}

impl Tried {
    fn rate(&self) -> f64 {
        self.rays as f64 / median(&self.seconds).max(1e-9)
    }
}

/// One line of the table; every setting's figures go to stderr.
fn measure(args: &Args, path: &Path) -> Result<String> {
    let (width, height) = args.size;
    let view = View::new(width, height, 1.0, 1.0)?;
    let (max_depth, transfer) = (args.max_depth, Transfer::Linear);
    let settings = Settings { view, max_depth, sampling: Sampling::Adaptive, transfer };
    let scene = Scene::read(path, settings, args.threads)?;
    let truth = scene.truth(&args.references, args.samples)?;
    eprintln!("{}: the reference is off by about {:.3}", scene.name, 255.0 * truth.own);

    let mut tried = first_round(args, &scene, &truth)?;
    let povray = povray::Export::new(&scene, args.threads)?;
    let mut theirs: Vec<f64> = povray.iter().filter_map(povray::Export::seconds).collect();
    for _ in 1..args.runs {
        for t in &mut tried {
            t.seconds.push(scene.render(t.setting)?.seconds);
        }
        theirs.extend(povray.iter().filter_map(povray::Export::seconds));
    }
    for t in &tried {
        let told = t.told.map_or_else(String::new, |told| format!("  told {told:.3}"));
        eprintln!(
            "  {:<16} {:8.3} s  rmse {:7.3}{told}  {:6.1} Mrays/s",
            t.setting.name(),
            median(&t.seconds),
            t.error,
            t.rate() / 1e6
        );
    }
    Ok(line(&scene.name, &tried, (!theirs.is_empty()).then(|| median(&theirs))))
}

/// Renders every setting once, as far as uniform ones are worth it.
fn first_round(args: &Args, scene: &Scene, truth: &Truth) -> Result<Vec<Tried>> {
    let try_one = |setting: Setting| -> Result<Tried> {
        let Picture { pixels, rays, seconds, told } = scene.render(setting)?;
        let error = 255.0 * rmse(&pixels, &truth.pixels);
        Ok(Tried { setting, error, told, rays, seconds: vec![seconds] })
    };
    // The first render of all warms everything up.
    scene.render(Setting::Grid(1))?;
    let mut tried = Vec::new();
    for kind in [Setting::Grid, Setting::Scrambled] {
        for edge in EDGES {
            let one = try_one(kind(edge))?;
            let enough = one.error < 0.9 * ERRORS[ERRORS.len() - 1];
            tried.push(one);
            if enough {
                break;
            }
        }
    }
    for steps in TARGETS {
        if steps > 1.5 * 255.0 * Quality::Reference.rmse() || !args.no_reference_quality {
            tried.push(try_one(Setting::Error(steps))?);
        }
    }
    Ok(tried)
}

fn line(name: &str, tried: &[Tried], povray: Option<f64>) -> String {
    let curve = |is: fn(&Setting) -> bool| {
        Curve::new(tried.iter().filter(|t| is(&t.setting)).map(|t| (t.error, median(&t.seconds))))
    };
    let uniform = [curve(|s| matches!(s, Setting::Grid(_))), curve(|s| matches!(s, Setting::Scrambled(_)))];
    let adaptive = curve(|s| matches!(s, Setting::Error(_)));
    let costs = ERRORS.map(|error| {
        let quickest = uniform.iter().filter_map(|c| c.seconds(error)).min_by(f64::total_cmp);
        match (adaptive.seconds(error), quickest) {
            (Some(ours), Some(uniform)) => format!("{ours:.3} ({:.2}×)", ours / uniform),
            (Some(ours), None) => format!("{ours:.3} (no uniform one reaches it)"),
            (None, _) => "–".into(),
        }
    });
    let of = |steps: f64| tried.iter().find(|t| matches!(t.setting, Setting::Error(s) if s == steps));
    let middle = tried.iter().find(|t| matches!(t.setting, Setting::Grid(4)));
    let rates = of(0.5).zip(middle).map_or_else(|| "–".into(), |(a, u)| format!("{:.2}×", a.rate() / u.rate()));
    let told = Quality::ALL.map(|quality| {
        let steps = 255.0 * quality.rmse();
        let found = tried.iter().find(|t| matches!(t.setting, Setting::Error(s) if (s / steps - 1.0).abs() < 1e-6));
        let ratio = found.and_then(|t| Some(t.error / t.told?));
        ratio.map_or_else(|| "–".into(), |r| format!("{r:.2}"))
    });
    let povray = povray.map_or_else(|| "–".into(), |s| format!("{s:.3} s"));
    format!("| {name} | {} | {rates} | {} | {povray} |", costs.join(", "), told.join(", "))
}
