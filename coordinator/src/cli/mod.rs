//! From the command line to an exit code.

mod access;
mod args;
mod check;
mod compare;
mod completions;
mod condition;
mod console;
mod describe;
mod events;
mod exit;
mod farm;
mod fetch;
mod files;
mod finish;
mod fleet;
mod jobs;
mod journal;
mod measure;
mod options;
mod page;
mod picture;
mod progress;
mod remote;
mod render;
mod report;
mod runtime;
mod scene;
mod serve;
mod signals;
mod submit;
mod verification;

use std::time::Instant;

use clap::Parser;
use worker::otlp::Otlp;

use args::{Args, Command};
use console::Console;
pub(crate) use exit::Exit;
use farm::Change;

/// Reads the arguments and does what they say.
pub(crate) fn run() -> Exit {
    let began = Instant::now();
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(e) => {
            // Help and version are no errors: they go to stdout, and are results.
            let printed = e.print();
            if e.use_stderr() {
                return Exit::Usage;
            }
            return match console::written_out(printed) {
                Ok(()) => Exit::Done,
                Err(failure) => {
                    Console::new().error(&failure.message);
                    failure.exit
                }
            };
        }
    };
    let console = Console::new();
    // Ends last, so that all spans are sent.
    let otlp = match args.command.otlp().map(|to| Otlp::start(to, "coordinator")).transpose() {
        Ok(otlp) => otlp,
        Err(e) => {
            console.error(&format!("cannot start: {e}"));
            return Exit::Failed;
        }
    };
    console.log(args.verbose, otlp.as_ref());
    let done = match args.command {
        Command::Render(raw) => render::run(*raw, &console, began),
        Command::Serve(raw) => serve::run(&raw, &console),
        Command::Fleet(raw) => fleet::run(&raw, &console),
        Command::Submit(raw) => submit::run(*raw, &console),
        Command::Jobs(raw) => jobs::list(&raw, &console),
        Command::Workers(raw) => jobs::workers(&raw, &console),
        Command::Pause(raw) => jobs::change(&raw, Change::Pause, &console),
        Command::Resume(raw) => jobs::change(&raw, Change::Resume, &console),
        Command::Cancel(raw) => jobs::change(&raw, Change::Cancel, &console),
        Command::Fetch(raw) => fetch::run(&raw, &console),
        Command::Check(raw) => check::run(&raw, &console),
        Command::Picture(raw) => picture::run(&raw, &console),
        Command::Compare(raw) => compare::run(&raw, &console),
        Command::Measure(raw) => measure::run(*raw, &console, began),
        Command::Token { command, user } => access::token(command.unwrap_or_default(), user, &console),
        Command::Completions { shell } => console.out(&completions::script(shell)).map(|()| Exit::Done),
    };
    done.unwrap_or_else(|failure| {
        console.error(&failure.message);
        failure.exit
    })
}
