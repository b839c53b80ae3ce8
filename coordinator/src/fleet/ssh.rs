//! A fleet's workers on hosts of a list, each started over the user's own `ssh`: its configuration says how a host is
//! reached.
//!
//! A worker lives as long as its stdin on the other side: whatever ends this process, the line breaks, and the worker
//! is told to leave. The token is the first line that comes that way.

use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use tessera_proto::convert::printable;
use tessera_proto::limits::BUILD;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::process::Command;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::call::{CallError, call, call_with};
use super::placement::Standing;
use super::{Fleet, TokenSource, WorkerOrder, quoted, seconds};

/// How `ssh` is called: a question that nobody answers is a failure.
const SSH: [&str; 3] = ["ssh", "-o", "BatchMode=yes"];
/// How long a worker may take to leave before its line is cut.
const LEAVE_WITHIN: Duration = Duration::from_secs(60);
/// Between two attempts on a host, at first and at last.
const RETRY: (Duration, Duration) = (Duration::from_secs(5), Duration::from_secs(120));

/// Hosts of a list: one a line, as `ssh` takes them; `#` begins a comment.
///
/// # Errors
/// When it cannot be read, names none, or a line is no host.
pub(super) fn hosts(path: &Path) -> Result<Vec<String>, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("'{}': {e}", path.display()))?;
    let mut hosts = Vec::new();
    for (n, line) in text.lines().enumerate() {
        let host = line.split('#').next().unwrap_or_default().trim();
        // What begins with a dash would be an option.
        if host.starts_with('-') || host.contains(|c: char| c.is_whitespace() || c.is_control()) {
            return Err(format!("'{}', line {}: '{}' is no host", path.display(), n + 1, printable(host)));
        }
        if !host.is_empty() && !hosts.iter().any(|h| h == host) {
            hosts.push(host.to_owned());
        }
    }
    if hosts.is_empty() { Err(format!("'{}' names no host", path.display())) } else { Ok(hosts) }
}

/// The command that a host is given; `program` is as its shell has it.
fn remote(order: &WorkerOrder, program: &str) -> String {
    let connect = quoted(&order.connect.to_string());
    let mut worker = format!(
        "{program} --connect {connect} --name \"$(hostname)\" --give-up-after {}",
        seconds(order.give_up_after)
    );
    if order.once {
        worker += " --once";
    }
    if let Some(lifetime) = order.lifetime {
        worker += &format!(" --lifetime {}", seconds(lifetime));
    }
    if let TokenSource::File(path) = &order.token {
        worker += &format!(" --token-file {}", quoted(&path.to_string_lossy()));
    }
    let script = format!(
        "IFS= read -r token || exit 1; if [ -n \"$token\" ]; then TESSERA_TOKEN=$token; export TESSERA_TOKEN; fi; \
         exec 3<&0; {worker} </dev/null 3<&- & worker=$!; \
         (cat <&3; kill \"$worker\") >/dev/null 2>&1 & line=$!; exec 3<&-; \
         wait \"$worker\"; code=$?; kill \"$line\" 2>/dev/null; exit \"$code\""
    );
    format!("exec sh -c {}", always_quoted(&script))
}

/// `text` as one word of any shell that a user may have there.
fn always_quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// A script that starts the workers by hand.
pub(super) fn print(fleet: &Fleet, hosts: &[String]) -> String {
    let program = fleet.program_there();
    let mut text = String::from(
        "#!/bin/sh\n# The farm's token, where it asks for one, is taken from TESSERA_TOKEN. Workers live as long as this \
         script.\ntrap 'trap - INT TERM; kill 0' INT TERM\n",
    );
    for host in hosts.iter().take(fleet.scaling.size.max) {
        let command = always_quoted(&remote(&fleet.order, &quoted(&program)));
        text += &format!(
            "{{ echo \"$TESSERA_TOKEN\"; exec sleep 2147483647; }} | {} {} {command} &\n",
            words(&fleet.args).join(" "),
            quoted(host)
        );
    }
    text + "wait\n"
}

/// `ssh` with the user's own options.
fn words(args: &str) -> Vec<String> {
    SSH.iter().map(ToString::to_string).chain(args.split_whitespace().map(Into::into)).collect()
}

/// A host, and how it is doing.
#[derive(Debug)]
struct Host {
    name: String,
    /// While there is a worker, or one is being started.
    work: Option<(JoinHandle<Result<(), String>>, CancellationToken)>,
    not_before: Option<Instant>,
    retry: Duration,
    /// How its last worker ended, where that was no peaceful end.
    failure: Option<String>,
    /// Whether one ever ended in peace.
    good: bool,
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Hosts(Vec<Host>);

impl Hosts {
    pub(super) fn new(path: &Path) -> Result<Self, String> {
        let host = |name| Host { name, work: None, not_before: None, retry: RETRY.0, failure: None, good: false };
        Ok(Self(hosts(path)?.into_iter().map(host).collect()))
    }

    /// Starts so many workers, on hosts that have none; on fewer where there are no more.
    pub(super) async fn add(&mut self, fleet: &Fleet, count: usize) -> Result<(), CallError> {
        self.settle().await;
        if self.0.iter().all(|host| host.failure.is_some() && !host.good) {
            let first = self.0.first().and_then(|host| Some(format!("{}: {}", host.name, host.failure.as_ref()?)));
            return Err(CallError::Refused(first.unwrap_or_default()));
        }
        let now = Instant::now();
        let free = self.0.iter_mut().filter(|h| h.work.is_none() && h.not_before.is_none_or(|at| at <= now));
        for host in free.take(count) {
            let stop = CancellationToken::new();
            let started = work(host.name.clone(), fleet.clone(), stop.clone());
            host.work = Some((tokio::spawn(started), stop));
        }
        Ok(())
    }

    /// Takes note of workers that have ended.
    async fn settle(&mut self) {
        for host in &mut self.0 {
            if !host.work.as_ref().is_some_and(|(task, _)| task.is_finished()) {
                continue;
            }
            let Some((task, _)) = host.work.take() else { continue };
            match task.await.unwrap_or_else(|e| Err(e.to_string())) {
                Ok(()) => (host.good, host.retry) = (true, RETRY.0),
                Err(why) => {
                    if host.failure.as_ref() != Some(&why) {
                        tracing::warn!(target: "farm", "{}: {why}", host.name);
                    }
                    host.failure = Some(why);
                    host.not_before = Some(Instant::now() + host.retry);
                    host.retry = (2 * host.retry).min(RETRY.1);
                }
            }
        }
    }

    pub(super) async fn standing(&mut self) -> Standing {
        self.settle().await;
        let running = self.0.iter().filter(|host| host.work.is_some()).map(|host| host.name.clone()).collect();
        Standing { waiting: Vec::new(), running }
    }

    /// Has the workers of these hosts leave; all where none is named.
    pub(super) fn remove(&self, hosts: Option<&[String]>) {
        for host in &self.0 {
            if let Some((_, stop)) = &host.work
                && hosts.is_none_or(|hosts| hosts.contains(&host.name))
            {
                stop.cancel();
            }
        }
    }
}

/// A host's worker, from its start to its end.
async fn work(host: String, fleet: Fleet, stop: CancellationToken) -> Result<(), String> {
    let found = tokio::select! {
        found = program(&host, &fleet) => found?,
        () = stop.cancelled() => return Ok(()),
    };
    let words = words(&fleet.args);
    let mut command = Command::new(&words[0]);
    command.args(&words[1..]).arg(&host).arg(remote(&fleet.order, &found));
    command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).kill_on_drop(true);
    #[cfg(unix)]
    command.process_group(0);
    let mut child = command.spawn().map_err(|e| format!("'ssh' cannot be run: {e}"))?;
    let mut line = child.stdin.take();
    if let Some(line) = &mut line {
        let token = match &fleet.order.token {
            TokenSource::Environment(token) => token.reveal(),
            _ => String::new(),
        };
        // Where it is gone already, its exit says why.
        let _ = line.write_all(format!("{token}\n").as_bytes()).await;
    }
    let said = child.stderr.take();
    let said = tokio::spawn(async move { last_words(said).await });
    let status = tokio::select! {
        status = child.wait() => status,
        () = stop.cancelled() => {
            // The worker there leaves with its line.
            drop(line.take());
            match tokio::time::timeout(LEAVE_WITHIN, child.wait()).await {
                Ok(_) => {}
                Err(_) => { let _ = child.kill().await; }
            }
            return Ok(());
        }
    };
    let status = status.map_err(|e| e.to_string())?;
    if status.success() {
        return Ok(());
    }
    // What it left running may hold its stderr.
    let said = tokio::time::timeout(Duration::from_secs(1), said).await.ok().and_then(Result::ok).unwrap_or_default();
    Err(if said.is_empty() { format!("the worker ended: {status}") } else { said })
}

/// The last line that comes.
async fn last_words(from: Option<impl tokio::io::AsyncRead + Unpin>) -> String {
    let Some(mut from) = from else { return String::new() };
    let (mut kept, mut piece) = (Vec::new(), [0; 4096]);
    while let Ok(n @ 1..) = from.read(&mut piece).await {
        kept.extend_from_slice(&piece[..n]);
        let excess = kept.len().saturating_sub(8192);
        kept.drain(..excess);
    }
    let text = String::from_utf8_lossy(&kept).into_owned();
    printable(text.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default().trim())
}

/// The worker program on a host, as its shell calls it; copied there where none of this build is.
async fn program(host: &str, fleet: &Fleet) -> Result<String, String> {
    if fleet.order.program.is_given() {
        return Ok(quoted(&fleet.program_there()));
    }
    let ssh = |script: &str| -> Vec<String> {
        let command = format!("exec sh -c {}", always_quoted(script));
        words(&fleet.args).into_iter().chain([host.to_owned(), command]).collect()
    };
    let cached = format!("\"$HOME\"/.cache/tessera/worker-{BUILD}");
    let probe = format!(
        "uname -sm; for w in {cached} \"$(command -v worker)\"; do \
         if [ \"$(\"$w\" --version 2>/dev/null)\" = 'worker {BUILD}' ]; then echo \"$w\"; break; fi; done"
    );
    let said = call(&ssh(&probe), "", &[]).await.map_err(|e| e.to_string())?;
    let mut lines = said.lines();
    let platform = lines.next().unwrap_or_default().trim().to_owned();
    if let Some(found) = lines.next() {
        return Ok(quoted(found.trim()));
    }
    let own = format!(
        "{} {}",
        if cfg!(target_os = "linux") { "Linux" } else { std::env::consts::OS },
        std::env::consts::ARCH
    );
    if platform != own {
        return Err(format!("there is no worker of build {BUILD}, and '{}' is another platform", printable(&platform)));
    }
    let local = fleet.program_there();
    let binary = tokio::fs::read(&local).await;
    let binary =
        binary.map_err(|e| format!("there is no worker of build {BUILD}, and '{local}' cannot be read: {e}"))?;
    let copy = format!(
        "umask 077; mkdir -p \"$HOME\"/.cache/tessera && cat > {cached}.$$ && chmod 700 {cached}.$$ && \
         mv {cached}.$$ {cached}"
    );
    let minutes = Duration::from_secs(600);
    call_with(&ssh(&copy), &binary, &[], minutes).await.map_err(|e| format!("the worker cannot be copied: {e}"))?;
    Ok(cached)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_hosts_have_comments_and_no_options() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &str| {
            std::fs::write(file.path(), text).unwrap();
            hosts(file.path())
        };
        assert_eq!(read("# all\nann@a\n\n b  # slow\nann@a\n").unwrap(), ["ann@a", "b"]);
        for bad in ["", "# none\n", "a\n-oProxyCommand=evil\n", "two words\n"] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }
}
