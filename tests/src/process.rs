//! Programs that are signalled while they run, and heard line by line.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use crate::program::program;

/// Longer than anything here takes.
const NEVER: Duration = Duration::from_secs(60);

/// Bytes of memory that a process has, by its number; 0 where the system does not tell.
#[must_use]
pub fn resident(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:")).unwrap_or_default();
    1024 * line.split_whitespace().next().and_then(|n| n.parse::<u64>().ok()).unwrap_or(0)
}

/// A program at work; killed when dropped.
#[derive(Debug)]
pub struct Process {
    child: Child,
    lines: Mutex<Receiver<String>>,
    said: String,
}

impl Process {
    /// Starts the program `name`; what it says on stderr is kept.
    ///
    /// # Panics
    /// When it cannot be started.
    #[must_use]
    pub fn start(name: &str, args: &[&str]) -> Self {
        let mut command = Command::new(program(name));
        command.args(args).env_remove("RUST_LOG").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the program starts");
        let stderr = BufReader::new(child.stderr.take().expect("piped"));
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        Self { child, lines: Mutex::new(lines), said: String::new() }
    }

    /// Sends a signal.
    ///
    /// # Panics
    /// When there is no such process any more.
    pub fn signal(&self, signal: Signal) {
        let pid = Pid::from_child(&self.child);
        kill_process(pid, signal).expect("it is there to be signalled");
    }

    /// Waits for it to say something that holds `text`, and gives all that it said until then.
    ///
    /// # Panics
    /// When it ends, or takes a minute, without.
    pub fn says(&mut self, text: &str) -> &str {
        let lines = self.lines.get_mut().expect("no panic before");
        while !self.said.contains(text) {
            let line = lines.recv_timeout(NEVER).unwrap_or_else(|e| panic!("{e}; it said only:\n{}", self.said));
            self.said += &line;
            self.said.push('\n');
        }
        &self.said
    }

    /// Waits for its end; also gives what it said.
    ///
    /// # Panics
    /// When it does not end within a minute.
    pub fn end(mut self) -> (ExitStatus, String) {
        let start = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("it is ours") {
                break status;
            }
            assert!(start.elapsed() < NEVER, "it does not end");
            std::thread::sleep(Duration::from_millis(5));
        };
        let lines = self.lines.get_mut().expect("no panic before");
        self.said.extend(lines.iter().map(|line| line + "\n"));
        (status, std::mem::take(&mut self.said))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
