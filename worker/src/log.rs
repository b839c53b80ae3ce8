//! What the program says, on stderr: for people, and no reason to stop where nobody can hear it.

use std::io::{IsTerminal, Write, stderr};

use tessera_proto::layers_at;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};
use worker::otlp::Otlp;
use worker::spans::unspoken;

/// Starts logging, and the export of spans; `RUST_LOG` overrides `verbose`.
pub(crate) fn start(verbose: u8, otlp: Option<&Otlp>) {
    // Other people's layers speak for themselves only where everything is asked for.
    let level = match verbose {
        0 => format!("warn,worker=info,{}", layers_at("error")),
        1 => format!("info,worker=debug,{}", layers_at("error")),
        2 => format!("debug,worker=trace,{}", layers_at("warn")),
        _ => "trace".into(),
    };
    let filter = match std::env::var("RUST_LOG") {
        Ok(spec) if !spec.is_empty() => EnvFilter::new(spec),
        _ => EnvFilter::new(level),
    };
    let unwanted = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
    let said = tracing_subscriber::fmt::layer()
        .with_writer(|| Deaf)
        .with_ansi(stderr().is_terminal() && !unwanted)
        .with_target(verbose > 1)
        .with_filter(unspoken(filter));
    let log = tracing_subscriber::registry().with(said);
    // A layer that is none would cost every span and every line the look at it.
    match otlp {
        Some(otlp) => log.with(otlp.layer()).init(),
        None => log.init(),
    }
}

/// A line outside the log.
pub(crate) fn say(line: &str) {
    let _ = writeln!(Deaf, "{line}");
}

/// Stderr, whose failures are nobody's business: a closed pipe, a full disk or a terminal that is gone must not
/// end a worker.
struct Deaf;

impl Write for Deaf {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let _ = stderr().lock().write_all(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
