//! From the command line to an exit code.

mod args;
mod check;
mod compare;
mod condition;
mod console;
mod describe;
mod exit;
mod files;
mod finish;
mod journal;
mod measure;
mod options;
mod picture;
mod progress;
mod render;
mod report;
mod scene;
mod signals;

use std::time::Instant;

use clap::{CommandFactory, Parser};

use args::{Args, Command};
use console::Console;
pub(crate) use exit::Exit;

/// Reads the arguments and does what they say.
pub(crate) fn run() -> Exit {
    let began = Instant::now();
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(e) => {
            // Help and version are no errors: they go to stdout. Nothing is left to do where that is closed.
            let _ = e.print();
            return if e.use_stderr() { Exit::Usage } else { Exit::Done };
        }
    };
    let console = Console::new();
    console.log(args.verbose);
    let done = match args.command {
        Command::Render(raw) => render::run(*raw, &console, began),
        Command::Check(raw) => check::run(&raw, &console),
        Command::Picture(raw) => picture::run(&raw, &console),
        Command::Compare(raw) => compare::run(&raw, &console),
        Command::Measure(raw) => measure::run(*raw, &console, began),
        Command::Completions { shell } => {
            let mut text = Vec::new();
            clap_complete::generate(shell, &mut Args::command(), "coordinator", &mut text);
            console.out(&String::from_utf8_lossy(&text));
            Ok(Exit::Done)
        }
    };
    done.unwrap_or_else(|failure| {
        console.error(&failure.message);
        failure.exit
    })
}
