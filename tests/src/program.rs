//! The real programs, as child processes.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Output, Stdio};
use std::sync::OnceLock;

use serde_json::Value;

/// The path of program `name` of this workspace, built from the current sources.
///
/// A test may only ask cargo for the programs of its own package, and these belong to
/// others: they are built here, once a test process, in the profile and folder that the
/// test itself was built in. Where they are up to date, that takes a moment.
///
/// # Panics
/// When they do not build.
#[must_use]
pub fn program(name: &str) -> PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        // …/target/release/deps/test-0123: the programs lie beside `deps`, as those that measure do.
        let test = std::env::current_exe().expect("a running test has a file");
        let deps = test.ancestors().find(|p| p.ends_with("deps"));
        let folder = deps.unwrap_or(&test).parent().expect("cargo's layout");
        let profile = match folder.file_name().and_then(OsStr::to_str) {
            Some("debug") | None => "dev",
            Some(name) => name,
        };
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut build = Command::new(cargo);
        // What cargo tells a test about itself makes build scripts run again that ask for such variables, and then all
        // that depends on them.
        for (name, _) in std::env::vars_os() {
            let own = name.to_string_lossy();
            if ["CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_BIN_", "CARGO_TARGET_TMPDIR"].iter().any(|p| own.starts_with(p))
            {
                build.env_remove(&name);
            }
        }
        let built = build
            // With a test among the targets, dependencies have the features that they have under
            // `cargo test --workspace`, and are not built a second time.
            .args(["build", "--quiet", "--workspace", "--bins", "--test", "cli_other"])
            .args(["--profile", profile, "--manifest-path"])
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.toml"))
            .arg("--target-dir")
            .arg(folder.parent().expect("a target folder"))
            .status()
            .expect("cargo runs");
        assert!(built.success(), "the programs do not build");
        folder.to_path_buf()
    });
    folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX))
}

/// The report that `--report` wrote to a file.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn report(file: &Path) -> Value {
    let text = std::fs::read_to_string(file).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

/// The hash of the pixels in a report.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn pixels_hash(file: &Path) -> String {
    report(file)["pixels_sha256"].as_str().expect("a hash").to_owned()
}

/// `coordinator` with `arguments`, in folder `at`, logging and colours as by default.
#[must_use]
pub fn coordinator<A: AsRef<OsStr>>(at: &Path, arguments: impl IntoIterator<Item = A>) -> Command {
    let mut command = Command::new(program("coordinator"));
    command.current_dir(at).args(arguments).env_remove("RUST_LOG").stdin(Stdio::null());
    command
}

/// How a program ended, and what it said.
#[derive(Debug)]
pub struct Ended {
    /// Its exit code; `None` where a signal ended it.
    pub code: Option<i32>,
    /// What it wrote to stdout.
    pub out: String,
    /// What it wrote to stderr.
    pub err: String,
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// Runs `coordinator` with `arguments` in folder `at` to its end.
///
/// # Panics
/// When it does not start.
#[must_use]
pub fn run<A: AsRef<OsStr>>(at: &Path, arguments: impl IntoIterator<Item = A>) -> Ended {
    coordinator(at, arguments).output().expect("coordinator starts").into()
}

/// A program that runs while the test does; killed when dropped.
#[derive(Debug)]
pub struct Running {
    child: Child,
    err: Option<BufReader<ChildStderr>>,
}

impl Running {
    /// Starts `command` with its stderr to be read here.
    ///
    /// # Panics
    /// When it does not start.
    #[must_use]
    pub fn start(command: &mut Command) -> Self {
        let mut child = command.stderr(Stdio::piped()).spawn().expect("the program starts");
        let err = child.stderr.take().map(BufReader::new);
        Self { child, err }
    }

    /// Its process id.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Reads its stderr up to the first line that `wanted` accepts; `None` where it ends before.
    ///
    /// # Panics
    /// When stderr cannot be read.
    pub fn line(&mut self, wanted: impl Fn(&str) -> bool) -> Option<String> {
        let err = self.err.as_mut()?;
        loop {
            let mut line = String::new();
            if err.read_line(&mut line).expect("stderr is text") == 0 {
                return None;
            }
            if wanted(&line) {
                return Some(line);
            }
        }
    }

    /// Sends it `signal`, such as INT.
    ///
    /// # Panics
    /// When that fails.
    pub fn signal(&self, signal: &str) {
        let sent = Command::new("kill").arg(format!("-{signal}")).arg(self.id().to_string()).status();
        assert!(sent.expect("kill runs").success());
    }

    /// Waits for its end; gives also what it still had to say on stderr.
    ///
    /// # Panics
    /// When it cannot be waited for.
    #[must_use]
    pub fn wait(mut self) -> (ExitStatus, String) {
        let mut rest = String::new();
        if let Some(mut err) = self.err.take() {
            err.read_to_string(&mut rest).expect("stderr is text");
        }
        (self.child.wait().expect("it can be waited for"), rest)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Both fail only where it has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The path of a scene among the tests' own.
#[must_use]
pub fn scene(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
}
