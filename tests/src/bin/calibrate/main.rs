//! Fits the constants anew that decide what pictures cost and how far they are off, and holds them against those in
//! the source.
//!
//! ```text
//! edges of known place ─▶ sampler        generated scenes ─▶ plan
//! costs of tiles, a real coordinator, a simulated crowd ─▶ scheduler
//! ```
//! `cargo xtask calibrate` prints a table for each; a constant that is chosen rather than fitted is named below it.
//! What is fitted to ratios of times, to tiles or to a coordinator is of the machine it ran on.

mod crowd;
mod pictures;
mod plan;
mod sampler;
mod scheduler;
mod table;

use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, ValueEnum};
use table::Table;

/// Any error: all this program does with one is to say it.
type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Constants that belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    /// What a number of points leads to (`core/src/sampling/pixel.rs`)
    Sampler,
    /// What a tolerance leads to, and costs (`coordinator/src/plan/model.rs`)
    Plan,
    /// What tiles cost (`coordinator/src/scheduler/model.rs`)
    Scheduler,
}

/// Fits constants anew, and says which of them still hold.
#[derive(Debug, Parser)]
#[command(name = "calibrate", max_term_width = 100)]
struct Args {
    /// Which constants
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Part::Sampler, Part::Plan, Part::Scheduler])]
    only: Vec<Part>,
}

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
    for part in &args.only {
        let began = Instant::now();
        let table: Table = match part {
            Part::Sampler => sampler::fit(),
            Part::Plan => plan::fit()?,
            Part::Scheduler => scheduler::fit()?,
        };
        println!("{table}");
        eprintln!("{:.0} s", began.elapsed().as_secs_f64());
    }
    Ok(())
}
