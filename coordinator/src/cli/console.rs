//! What the program says: results on stdout, everything else on stderr, never through a progress bar.

use std::io::{IsTerminal, Write, stderr, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

use console::Term;
use indicatif::{MultiProgress, ProgressDrawTarget, TermLike};
use tessera_proto::layers_at;
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};
use worker::otlp::Otlp;
use worker::spans::unspoken;

use super::exit::{Exit, Failure};

/// What a word is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tone {
    /// Something failed.
    Error,
    /// Something looks wrong.
    Warning,
}

/// Stdout and stderr, shared with the progress bar. Whoever closes a pipe does not want the rest, which is no
/// error; results that are wanted and cannot be written are one. Nothing that happens to stderr ends anything.
#[derive(Clone, Debug)]
pub(crate) struct Console {
    bars: MultiProgress,
    colour: bool,
}

impl Console {
    /// The console of this process.
    pub(crate) fn new() -> Self {
        let unwanted = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
        let terminal = stderr().is_terminal();
        let bars = MultiProgress::new();
        if terminal {
            bars.set_draw_target(ProgressDrawTarget::term_like_with_hz(Box::new(Narrow::stderr()), 15));
        }
        Self { bars, colour: terminal && !unwanted }
    }

    /// Where progress bars are drawn.
    pub(crate) fn bars(&self) -> &MultiProgress {
        &self.bars
    }

    /// Starts logging to stderr, and the export of spans; does nothing when logging has started already.
    pub(crate) fn log(&self, verbosity: u8, otlp: Option<&Otlp>) {
        // Who comes and goes is said always; other people's layers speak for themselves only at the loudest.
        let default = match verbosity {
            0 => format!("warn,farm=info,{}", layers_at("error")),
            1 => format!("info,{}", layers_at("error")),
            2 => format!("debug,{}", layers_at("warn")),
            _ => "trace".into(),
        };
        let filter = match std::env::var("RUST_LOG") {
            Ok(spec) if !spec.is_empty() => EnvFilter::new(spec),
            _ => EnvFilter::new(default),
        };
        let said = tracing_subscriber::fmt::layer()
            .with_ansi(self.colour)
            .with_target(verbosity > 1)
            .with_writer(LogWriter(self.clone()))
            .with_filter(unspoken(filter));
        let log = tracing_subscriber::registry().with(said).with(coordinator::web::log::layer());
        // A layer that is none would cost every span and every line the look at it.
        let _ = match otlp {
            Some(otlp) => log.with(otlp.layer()).try_init(),
            None => log.try_init(),
        };
    }

    /// A result: as it is, to stdout.
    ///
    /// # Errors
    /// When it is wanted and cannot be written.
    pub(crate) fn out(&self, text: &str) -> Result<(), Failure> {
        let written = stdout().lock().write_all(text.as_bytes()).and_then(|()| stdout().flush());
        written_out(written)
    }

    /// A line to stderr.
    pub(crate) fn say(&self, line: &str) {
        self.bars.suspend(|| {
            let _ = writeln!(stderr().lock(), "{line}");
        });
    }

    /// A line that begins with "error:".
    pub(crate) fn error(&self, message: &str) {
        self.say(&format!("{} {message}", self.paint(Tone::Error, "error:")));
    }

    /// A line that begins with "warning:".
    pub(crate) fn warning(&self, message: &str) {
        self.say(&format!("{} {message}", self.paint(Tone::Warning, "warning:")));
    }

    /// `text` in the colour of `tone`, where stderr shows colours.
    pub(crate) fn paint(&self, tone: Tone, text: &str) -> String {
        if !self.colour {
            return text.to_owned();
        }
        let code = match tone {
            Tone::Error => "1;31",
            Tone::Warning => "1;33",
        };
        format!("\x1b[{code}m{text}\x1b[0m")
    }
}

/// What became of a result: whoever closed the pipe did not want it, all else is a failure.
pub(crate) fn written_out(written: std::io::Result<()>) -> Result<(), Failure> {
    match written {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::new(Exit::Failed, format!("cannot write to stdout: {e}")))
        }
        _ => Ok(()),
    }
}

/// The terminal, said to be a little narrower than it is. Bars fill their line, and what
/// is echoed of Ctrl-C would break a full line in two, half of which would stay behind.
///
/// A terminal that was closed takes nothing more, and is told nothing more: the bars' library would panic over it.
#[derive(Debug)]
struct Narrow {
    term: Term,
    gone: AtomicBool,
}

impl Narrow {
    fn stderr() -> Self {
        Self { term: Term::buffered_stderr(), gone: AtomicBool::new(false) }
    }

    fn tell(&self, say: impl FnOnce(&Term) -> std::io::Result<()>) -> std::io::Result<()> {
        if !self.gone.load(Ordering::Relaxed) && say(&self.term).is_err() {
            self.gone.store(true, Ordering::Relaxed);
        }
        Ok(())
    }
}

impl TermLike for Narrow {
    fn width(&self) -> u16 {
        self.term.size().1.saturating_sub(3).max(1)
    }

    fn height(&self) -> u16 {
        self.term.size().0
    }

    fn move_cursor_up(&self, n: usize) -> std::io::Result<()> {
        self.tell(|term| term.move_cursor_up(n))
    }

    fn move_cursor_down(&self, n: usize) -> std::io::Result<()> {
        self.tell(|term| term.move_cursor_down(n))
    }

    fn move_cursor_right(&self, n: usize) -> std::io::Result<()> {
        self.tell(|term| term.move_cursor_right(n))
    }

    fn move_cursor_left(&self, n: usize) -> std::io::Result<()> {
        self.tell(|term| term.move_cursor_left(n))
    }

    fn write_line(&self, line: &str) -> std::io::Result<()> {
        self.tell(|term| term.write_line(line))
    }

    fn write_str(&self, text: &str) -> std::io::Result<()> {
        self.tell(|term| term.write_str(text))
    }

    fn clear_line(&self) -> std::io::Result<()> {
        self.tell(Term::clear_line)
    }

    fn flush(&self) -> std::io::Result<()> {
        self.tell(Term::flush)
    }
}

/// Log lines, kept apart from the bar.
struct LogWriter(Console);

impl<'a> MakeWriter<'a> for LogWriter {
    type Writer = LogLine<'a>;

    fn make_writer(&'a self) -> Self::Writer {
        LogLine(&self.0)
    }
}

struct LogLine<'a>(&'a Console);

impl Write for LogLine<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        // The log layer would say on stderr that stderr cannot be written, and panic over it.
        let _ = self.0.bars.suspend(|| stderr().lock().write_all(bytes));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
