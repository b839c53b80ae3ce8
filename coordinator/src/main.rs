//! The `coordinator` program: render, check, compare, measure.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run().into()
}
