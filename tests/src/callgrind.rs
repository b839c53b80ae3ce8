//! Instructions of some work in a process of its own, counted by valgrind's callgrind.

use std::hint::black_box;
use std::process::Command;

/// What callgrind counts: only what happens in here.
#[inline(never)]
fn counted_by_callgrind<T>(work: impl FnOnce() -> T) -> T {
    black_box(work())
}

/// Runs `work` in a pool of this thread alone, which is the one that is counted.
///
/// # Panics
/// Where a pool of one thread cannot be had.
pub fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
    pool.unwrap_or_else(|e| panic!("a pool of one thread: {e}")).install(|| counted_by_callgrind(work))
}

/// Instructions that this program takes within [`alone`] when it is called with `--kernel KERNEL`.
///
/// # Errors
/// What went wrong, in words.
pub fn count(kernel: &str) -> Result<u64, String> {
    let this = std::env::current_exe().map_err(|e| e.to_string())?;
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null", "--toggle-collect=*counted_by_callgrind*"])
        .arg(this)
        .args(["--kernel", kernel])
        .output()
        .map_err(|e| e.to_string())?;
    let said = String::from_utf8_lossy(&output.stderr);
    let collected = said.lines().find_map(|l| l.split_once("Collected : ").map(|(_, n)| n.trim().to_owned()));
    match collected.and_then(|n| n.parse().ok()) {
        Some(n) if output.status.success() && n > 0 => Ok(n),
        _ => Err(format!("callgrind did not count '{kernel}':\n{said}")),
    }
}

/// The instructions that programs are offered under valgrind: what this program says when it is called with
/// `--level`.
#[must_use]
pub fn level() -> Option<String> {
    let this = std::env::current_exe().ok()?;
    let output = Command::new("valgrind").args(["--tool=none", "-q"]).arg(this).arg("--level").output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
