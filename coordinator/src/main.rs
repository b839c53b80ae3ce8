//! The `coordinator` program: render, check, compare.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run().into()
}
