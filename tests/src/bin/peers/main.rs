//! Times whole jobs of Tessera and of other ray tracers side by side.
//!
//! ```text
//! scenes ─▶ files of each program ─▶ rounds: every program once a round ─▶ medians, ratios ─▶ tables
//!        ├▶ farm: the same picture by core alone, by two workers, by one ───────────────────▶ table
//!        └▶ exact: the same picture by core with and without wide arithmetic ───────────────▶ table
//! small scenes at the limits of numbers ─▶ every program, held against 512 bits ─────────────▶ table
//! ```

mod embree;
mod exact;
mod extremes;
mod farm;
mod figures;
mod process;
mod program;
mod scenes;
mod table;
mod tachyon;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use serde_json::json;
use tessera_core::settings::{Sampling, Settings, Transfer, View};

use figures::Series;
use program::{Job, Program};
use scenes::SceneFile;

/// Any error: all this program does with one is to say it.
type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

const MORE: &str = "\
Every program renders the same scenes with one sample a pixel, linear colours and 8-bit
PNG output (Embree: PFM), one after the other in every round, so that a machine that
slows down or speeds up does so for all. Programs that are not installed are left out.

  Tessera  'coordinator' beside this program; started by cargo, it is built first
  POV-Ray  'povray', no anti-aliasing, bounded recursion, its own trace time
  Tachyon  'tachyon', its own ray tracing time; given no pictures, half a pixel off
  Embree   --embree PROGRAM, called as 'PROGRAM SCENE.bin WIDTH HEIGHT OUT.pfm 16 1', which
           prints 'build X' and 'render X s'; given no pictures, and read from binary floats

Scenes made here: demo, mirrors, lights, sphereflake4, terrain64, knot-low, sphereflake6,
terrain512, knot. All of them take half an hour or so; the last three need 1 GB of disk.

Results: tables in Markdown on stdout and in OUT/peers.md, every run in OUT/peers.json.

Examples:
  peers demo mirrors                    two scenes made here
  peers --scenes DIR --runs 9           all scenes of a folder
  peers --scenes DIR --only farm demo   the cost of the farm beside core alone
  peers --scenes DIR --only exact       the cost of wide arithmetic
  peers --only extremes                 who is right at the limits of numbers";

/// Times whole jobs of Tessera, POV-Ray, Tachyon and an Embree program side by side.
#[derive(Debug, Parser)]
#[command(name = "peers", after_help = MORE, max_term_width = 100)]
struct Args {
    /// Scenes, by file name without .xml [default: all]
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// Use the scenes DIR/*.xml instead of those made here
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,
    /// Folder for scenes, pictures and results
    #[arg(long, value_name = "DIR", default_value = "target/peers")]
    out: PathBuf,
    /// Rounds; medians are shown
    #[arg(long, value_name = "N", default_value = "5", value_parser = clap::value_parser!(u32).range(1..=1000))]
    runs: u32,
    /// Pixels across and down
    #[arg(long, value_name = "WxH", default_value = "1280x960", value_parser = size)]
    size: (u32, u32),
    /// Rays in a path at most, the camera's included
    #[arg(long, value_name = "D", default_value = "6", value_parser = clap::value_parser!(u32).range(1..=256))]
    max_depth: u32,
    /// Threads of every program
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// A program on Embree; see below
    #[arg(long, value_name = "PROGRAM")]
    embree: Option<PathBuf>,
    /// Measure only this
    #[arg(long, value_name = "WHAT")]
    only: Option<Only>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Only {
    /// Whole jobs of all programs
    Jobs,
    /// The farm against core alone
    Farm,
    /// Core against itself without wide arithmetic
    Exact,
    /// How many small scenes at the limits of numbers each program gets right
    Extremes,
}

fn size(text: &str) -> std::result::Result<(u32, u32), String> {
    let edges = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let (w, h) = edges.ok_or("expected WIDTHxHEIGHT in pixels, such as 640x480")?;
    View::new(w, h, 1.0, 1.0).map(|_| (w, h)).map_err(|e| e.to_string())
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("peers: {e}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<()> {
    std::fs::create_dir_all(&args.out).map_err(|e| format!("no folder '{}': {e}", args.out.display()))?;
    let out = args.out.canonicalize()?;
    let settings = Settings {
        view: View::new(args.size.0, args.size.1, 1.0, 1.0)?,
        max_depth: args.max_depth,
        sampling: Sampling::Uniform { grid: 1 },
        transfer: Transfer::Linear,
    };
    let wanted = |what| args.only.is_none_or(|only| only == what);
    let scenes = match args.only {
        Some(Only::Extremes) => Vec::new(),
        _ => scenes::choose(args.scenes.as_deref(), &args.names, &out)?,
    };
    let mut text = format!(
        "{}x{} pixels, one sample each, at most {} rays a path, {} threads; medians of {} interleaved runs.\n",
        args.size.0, args.size.1, args.max_depth, args.threads, args.runs
    );
    let mut results = json!({ "size": args.size, "max_depth": args.max_depth, "threads": args.threads });
    if wanted(Only::Jobs) {
        let programs = Program::installed(args.embree.as_deref())?;
        let rows = scenes.iter().map(|scene| row(scene, &programs, &settings, args, &out));
        let rows = rows.collect::<Result<Vec<_>>>()?;
        text.push_str(&table::jobs(&programs, &rows));
        results["jobs"] = rows.iter().map(Row::json).collect();
    }
    if wanted(Only::Farm) {
        let farms = scenes.iter().map(|scene| Ok((scene.name.clone(), farm::measure(scene, &settings, args.runs)?)));
        let farms = farms.collect::<Result<Vec<_>>>()?;
        text.push_str(&table::farm(&farms));
        results["farm"] = farms.iter().map(|(name, s)| json!({ "scene": name, "runs": s.json() })).collect();
    }
    if wanted(Only::Exact) {
        let rows = scenes
            .iter()
            .map(|scene| Ok((scene.name.clone(), exact::measure(scene, &settings, args.threads, args.runs)?)));
        let rows = rows.collect::<Result<Vec<_>>>()?;
        text.push_str(&table::exact(&rows));
        results["exact"] = rows.iter().map(|(name, s)| json!({ "scene": name, "runs": s.json() })).collect();
    }
    // Only where it is asked for: the oracle takes its time.
    if args.only == Some(Only::Extremes) {
        let programs = Program::installed(args.embree.as_deref())?;
        let rows = extremes::measure(&programs, &out)?;
        text = table::extremes(&rows);
        results["extremes"] = rows.iter().map(extremes::Row::json).collect();
    }
    print!("{text}");
    write(&out, "peers.md", &text)?;
    write(&out, "peers.json", &format!("{results:#}\n"))
}

fn write(folder: &Path, name: &str, text: &str) -> Result<()> {
    let path = folder.join(name);
    std::fs::write(&path, text).map_err(|e| format!("cannot write '{}': {e}", path.display()).into())
}

/// One scene by all programs.
struct Row {
    scene: String,
    objects: usize,
    /// In the order of the programs, Tessera first; `None` where one failed.
    series: Vec<(&'static str, Option<Series>)>,
}

impl Row {
    fn json(&self) -> serde_json::Value {
        let runs: serde_json::Map<String, _> =
            self.series.iter().filter_map(|(name, s)| Some((name.to_string(), s.as_ref()?.json()))).collect();
        json!({ "scene": self.scene, "objects": self.objects, "runs": runs })
    }
}

/// Exports the scene to every program and runs them in rounds.
fn row(file: &SceneFile, programs: &[Program], settings: &Settings, args: &Args, out: &Path) -> Result<Row> {
    let job = Job { scene: file, settings, threads: args.threads, folder: out };
    let scene = file.read()?;
    for program in programs {
        program.export(&scene, &job).map_err(|e| format!("{} for {}: {e}", file.name, program.name()))?;
    }
    let objects = scene.object_count();
    // Nothing of the scene stays in memory beside the programs that are measured.
    drop(scene);
    let mut series: Vec<_> = programs.iter().map(|p| (p.name(), Some(Series::default()))).collect();
    for round in 1..=args.runs {
        let mut said = format!("{} {round}/{}:", file.name, args.runs);
        for (program, (name, series)) in programs.iter().zip(&mut series) {
            let Some(runs) = series else { continue };
            match program.run(&job) {
                Ok(figures) => {
                    let _ = write!(said, "  {name} {:.3} s", figures["whole"]);
                    runs.push(figures);
                }
                // Another program's failure is a gap in the table; ours ends the comparison.
                Err(e) if *name == program::TESSERA => return Err(e),
                Err(e) => {
                    eprintln!("{}: {name} failed: {e}", file.name);
                    *series = None;
                }
            }
        }
        eprintln!("{said}");
    }
    program::compare(programs, &job, &mut series);
    Ok(Row { scene: file.name.clone(), objects, series })
}
