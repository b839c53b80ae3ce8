//! One entry for every chore: `cargo xtask CHORE [ARGUMENTS]`. Each is another command, which is said before it runs.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, ExitCode};

use clap::{Parser, ValueEnum};

/// A chore.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Chore {
    /// All that has to hold before a change lands
    Ci,
    /// The tests, as the README has them
    Test,
    /// Benches by stage; further arguments choose among them
    Bench,
    /// Instructions of the hot kernels against the record; '--write' takes it anew
    Instructions,
    /// Slowdown of scenes made exactly against the record; '--write' takes it anew
    Cliffs,
    /// Hashes of pixels, taken anew; refused where the numeric mode was not raised
    Golden,
    /// Readers of what strangers write, for a minute each
    Fuzz,
    /// Times beside other programs
    Peers,
    /// Seconds to true errors, and true errors against told ones
    Accuracy,
    /// Constants of cost and accuracy, fitted anew
    Calibrate,
    /// A farm that stays: latencies, memory, what watching costs
    Farm,
    /// A real coordinator before thousands of fake workers
    Crowd,
    /// Thousands of workers under a simulated network and clock
    Simulate,
    /// Wrong tokens without end
    Flood,
    /// Static binaries for any Linux
    Release,
}

/// One entry for every chore
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", max_term_width = 100)]
struct Args {
    /// What to do
    #[arg(value_enum)]
    chore: Chore,
    /// For the command behind it
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    rest: Vec<OsString>,
}

/// The words of the command behind a chore, and what is set in its environment.
fn command(chore: Chore) -> (&'static str, &'static [(&'static str, &'static str)]) {
    match chore {
        Chore::Ci => (".ci/run", &[]),
        Chore::Test => ("cargo test --release --workspace", &[]),
        Chore::Bench => ("cargo bench -p tessera-tests --bench stages --", &[]),
        Chore::Instructions => ("cargo bench -p tessera-tests --bench instructions --", &[]),
        Chore::Cliffs => ("cargo bench -p tessera-tests --bench cliffs --", &[]),
        Chore::Golden => ("cargo run --release -p tessera-tests --bin golden --", &[]),
        Chore::Fuzz => ("cargo test --release -p tessera-tests --test fuzz --", &[("TESSERA_FUZZ_SECONDS", "60")]),
        Chore::Peers => ("cargo run --release -p tessera-tests --bin peers --", &[]),
        Chore::Accuracy => ("cargo run --release -p tessera-tests --bin accuracy --", &[]),
        Chore::Calibrate => ("cargo run --release -p tessera-tests --bin calibrate --", &[]),
        Chore::Farm => ("cargo run --release -p tessera-tests --bin farm_figures --", &[]),
        Chore::Crowd => ("cargo run --release -p tessera-tests --bin crowd --", &[]),
        Chore::Simulate => ("cargo run --release -p tessera-tests --bin simulate --", &[]),
        Chore::Flood => ("cargo run --release -p tessera-tests --bin flood --", &[]),
        Chore::Release => (".ci/release", &[]),
    }
}

fn main() -> ExitCode {
    let args = Args::parse();
    let (line, environment) = command(args.chore);
    let mut words = line.split(' ');
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."));
    let mut command = Command::new(words.next().unwrap_or_default());
    command.args(words).args(&args.rest).envs(environment.iter().copied()).current_dir(root);
    eprintln!("{line} {}", args.rest.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" "));
    match command.status() {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        Ok(status) => ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)),
        Err(e) => {
            eprintln!("it cannot be run: {e}");
            ExitCode::FAILURE
        }
    }
}
