//! Workers that a real Slurm starts. Where `SLURM_CONF` names no cluster that answers, this is skipped: `.ci/run` has one
//! of several nodes on one machine.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use tessera_tests::program::{Ended, Running, coordinator, pixels_hash, run, scene};
use tessera_tests::wait::until_within;

/// Longer than anything here takes: Slurm itself needs 20 s to miss a node.
const NEVER: Duration = Duration::from_secs(120);

fn until(what: &str, so: impl FnMut() -> bool) {
    let told = || format!("{what}\n{}", squeue(&["--states=all"]));
    until_within((NEVER, Duration::from_millis(200)), told, so);
}

fn squeue(more: &[&str]) -> String {
    let said = Command::new("squeue").args(["--noheader", "--array", "--format=%i|%T|%N"]).args(more).output();
    said.map(|said| String::from_utf8_lossy(&said.stdout).into_owned()).unwrap_or_default()
}

fn running() -> Vec<String> {
    squeue(&["--states=RUNNING"]).lines().map(Into::into).collect()
}

/// Whether there is a cluster; said where there is none.
fn there_is_one() -> bool {
    let answers = std::env::var_os("SLURM_CONF").is_some()
        && Command::new("squeue").arg("--noheader").output().is_ok_and(|said| said.status.success());
    if !answers {
        eprintln!("skipped: no Slurm answers here (SLURM_CONF)");
    }
    answers
}

fn render(at: &Path, view: &[&str], more: &[&str]) -> Command {
    let demo = scene("demo.xml");
    let fixed = ["render", demo.to_str().unwrap(), "--listen", "127.0.0.1:0", "--fleet", "slurm", "--progress", "none"];
    let mut command = coordinator(at, fixed.iter().chain(view).chain(more));
    command.env("XDG_STATE_HOME", at.join("state")).env_remove("TESSERA_TOKEN");
    command
}

/// All of it in one test: there is one cluster.
#[test]
fn a_real_cluster_renders_the_same_picture_and_keeps_no_job() {
    if !there_is_one() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let short = ["--size", "320x240", "--samples", "64"];
    let alone = ["render", "--report", "alone.json", "-o", "alone.png", "--progress", "none"];
    let demo = scene("demo.xml");
    assert_eq!(run(at, alone.iter().chain(&short).chain(&[demo.to_str().unwrap()])).code, Some(0));

    // Three workers with a token, and none afterwards.
    let more = ["--fleet-workers", "3", "--token-file", "token", "--report", "fleet.json"];
    let ended: Ended = render(at, &short, &more).output().unwrap().into();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(squeue(&[]), "");
    assert_eq!(pixels_hash(&at.join("fleet.json")), pixels_hash(&at.join("alone.json")));

    // What Slurm refuses is said in its words.
    let more = ["--fleet-workers", "1", "--fleet-args", "--partition=nowhere"];
    let ended: Ended = render(at, &short, &more).output().unwrap().into();
    assert_eq!(ended.code, Some(4), "{}", ended.err);
    assert!(ended.err.contains("nvalid partition"), "{}", ended.err);

    // A task that somebody cancels is replaced; an interrupt leaves nothing.
    let long = ["--size", "2000x1500", "--samples", "4096", "--journal", "none"];
    let under_way = Running::start(&mut render(at, &long, &["--fleet-workers", "3"]));
    until("three tasks", || running().len() == 3);
    let victim = running()[0].split('|').next().unwrap().to_owned();
    assert!(Command::new("scancel").arg(&victim).status().unwrap().success());
    until("another in its place", || {
        let now = running();
        now.len() == 3 && !now.iter().any(|line| line.starts_with(&format!("{victim}|")))
    });
    under_way.signal("INT");
    let (status, said) = under_way.wait();
    assert_eq!(status.code(), Some(130), "{said}");
    until("no job", || squeue(&[]).is_empty());

    // Killed, it can cancel nothing: they leave by themselves.
    let more = ["--fleet-workers", "3", "--fleet-give-up-after", "2s"];
    let under_way = Running::start(&mut render(at, &long, &more));
    until("three tasks", || running().len() == 3);
    under_way.signal("KILL");
    let _ = under_way.wait();
    until("no job", || squeue(&[]).is_empty());
}
