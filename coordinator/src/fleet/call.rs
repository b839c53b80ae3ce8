//! Runs an engine's commands.

use std::io::ErrorKind;
use std::process::Stdio;
use std::time::Duration;

use tessera_proto::convert::printable;
use tokio::io::AsyncWriteExt;
use tokio::process::Command;

/// Longer than a controller that is well takes to answer.
const WITHIN: Duration = Duration::from_secs(30);

/// Why a command did not do what it is for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum CallError {
    /// It is not there, or does not run.
    #[error("'{0}' cannot be run: {1}")]
    Start(String, String),
    /// It refused, and said why.
    #[error("{0}")]
    Refused(String),
    /// It takes too long.
    #[error("'{0}' does not answer")]
    Silent(String),
}

/// Runs `words`, giving it `input` and, beside what this process has, `environment`; gives what it prints.
pub(super) async fn call(
    words: &[String],
    input: &str,
    environment: &[(&str, Option<String>)],
) -> Result<String, CallError> {
    call_with(words, input.as_bytes(), environment, WITHIN).await
}

/// As [`call`], within another time.
pub(super) async fn call_with(
    words: &[String],
    input: &[u8],
    environment: &[(&str, Option<String>)],
    within: Duration,
) -> Result<String, CallError> {
    let program = words.first().cloned().unwrap_or_default();
    let mut command = Command::new(&program);
    command.args(words.iter().skip(1)).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.kill_on_drop(true);
    // A Ctrl-C at the terminal is for the coordinator, which still needs this one to have its jobs ended.
    #[cfg(unix)]
    command.process_group(0);
    for (name, value) in environment {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    let why = |e: &std::io::Error| match e.kind() {
        ErrorKind::NotFound => "there is no such program here".to_owned(),
        _ => e.to_string(),
    };
    let failed = |e: std::io::Error| CallError::Start(program.clone(), why(&e));
    let done = async {
        let mut child = command.spawn().map_err(failed)?;
        if let Some(mut stdin) = child.stdin.take() {
            // One that does not read what it is given says why by its exit.
            let _ = stdin.write_all(input).await;
        }
        child.wait_with_output().await.map_err(failed)
    };
    let output = tokio::time::timeout(within, done).await.map_err(|_| CallError::Silent(program.clone()))??;
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if output.status.success() {
        return Ok(out.into_owned());
    }
    let said = if err.trim().is_empty() { out.trim() } else { err.trim() };
    let said = printable(&said.lines().map(str::trim).collect::<Vec<_>>().join("; "));
    Err(CallError::Refused(if said.is_empty() { format!("'{program}' failed: {}", output.status) } else { said }))
}
