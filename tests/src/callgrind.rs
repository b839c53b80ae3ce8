//! Instructions of some work in a process of its own, counted by valgrind's callgrind, and held against a record.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::Path;
use std::process::{Command, ExitCode};

use tessera_core::simd::Level;

/// What is on record, by name.
pub type Record = BTreeMap<String, f64>;

/// A bench of counted work, whose record is `benches/FILE` in this crate. As a process of its own it does what `run`
/// is told; else `compare` counts, says what it finds beside the record, and gives the lines of a new one and whether
/// all is as it should be. With `--write` those lines are written. The tracer without vectors has other instructions
/// and valgrind knows no AVX-512, so it is AVX2's that are counted; where that cannot be, this is said, and no failure.
pub fn bench(
    file: &str,
    run: impl FnOnce(&str),
    compare: impl FnOnce(&Record) -> Result<(String, bool), String>,
) -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if let [first, kernel] = &args[..]
        && first == "--kernel"
    {
        run(kernel);
        return ExitCode::SUCCESS;
    }
    if args.iter().any(|a| a == "--level") {
        println!("{:?}", Level::best());
        return ExitCode::SUCCESS;
    }
    match level() {
        Some(level) if level == format!("{:?}", Level::Avx2) => {}
        Some(level) => {
            println!("valgrind offers {level} here: nothing is counted");
            return ExitCode::SUCCESS;
        }
        None => {
            println!("valgrind does not run here: nothing is counted");
            return ExitCode::SUCCESS;
        }
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches").join(file);
    let before = std::fs::read_to_string(&path)
        .unwrap_or_default()
        .lines()
        .filter_map(|l| l.split_once(' ').and_then(|(k, n)| Some((k.to_owned(), n.trim().parse().ok()?))))
        .collect();
    let ended = compare(&before).and_then(|(table, good)| {
        if args.iter().any(|a| a == "--write") {
            std::fs::write(&path, table).map_err(|e| format!("{}: {e}", path.display()))?;
            return Ok(true);
        }
        Ok(good)
    });
    match ended {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::FAILURE
        }
    }
}

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
fn level() -> Option<String> {
    let this = std::env::current_exe().ok()?;
    let output = Command::new("valgrind").args(["--tool=none", "-q"]).arg(this).arg("--level").output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
