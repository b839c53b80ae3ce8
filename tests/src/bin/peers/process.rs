//! A child process, timed from start to end, and its peak memory.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// What a process took and said.
#[derive(Debug)]
pub(crate) struct Measured {
    /// Wall-clock time from its start to its end.
    pub(crate) whole: Duration,
    /// Its largest resident memory in bytes, where the system tells.
    pub(crate) peak: Option<u64>,
    /// What it wrote to stdout, then to stderr.
    pub(crate) text: String,
}

/// Runs `command` to its end.
///
/// # Errors
/// When it does not start or does not succeed; then with the last it said.
pub(crate) fn measure(command: &mut Command) -> io::Result<Measured> {
    let start = Instant::now();
    let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let watch = File::open(format!("/proc/{}/status", child.id())).ok().map(|status| thread::spawn(|| peak(status)));
    let output = child.wait_with_output()?;
    let whole = start.elapsed();
    let peak = watch.and_then(|w| w.join().ok()).flatten();
    let text = [output.stdout, output.stderr].map(|b| String::from_utf8_lossy(&b).into_owned()).concat();
    if !output.status.success() {
        let lines: Vec<&str> = text.lines().filter(|l| !l.trim().is_empty()).collect();
        let last = lines[lines.len().saturating_sub(5)..].join("\n");
        return Err(io::Error::other(format!("{}\n{last}", output.status)));
    }
    Ok(Measured { whole, peak, text })
}

/// Reads the high-water mark of resident memory until the process is gone.
///
/// `wait4` reports the larger of the child's mark and its parent's at the fork, which is
/// of no use here; the kernel's mark for the child itself only ever rises, so that the
/// last reading is the peak but for its final milliseconds.
fn peak(mut status: File) -> Option<u64> {
    let (mut text, mut peak) = (String::new(), None);
    loop {
        text.clear();
        let read = status.seek(SeekFrom::Start(0)).and_then(|_| status.read_to_string(&mut text));
        // A process that has ended has no such line, and later no such file.
        let mark = text.lines().find_map(|l| l.strip_prefix("VmHWM:")?.trim().strip_suffix("kB")?.trim().parse().ok());
        let (Ok(_), Some(kilobytes)) = (read, mark) else { return peak };
        peak = Some(1024 * u64::max(kilobytes, peak.unwrap_or(0) / 1024));
        thread::sleep(Duration::from_millis(2));
    }
}
