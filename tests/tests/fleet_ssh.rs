//! Workers on hosts of a list, over an `ssh` of the test's own that runs what it is given on this machine.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use tessera_tests::program::{Ended, Running, coordinator, pixels_hash, program, run, scene};
use tessera_tests::wait::until;

/// Hosts, each a home folder. One called `down` is not reached.
const SSH: &str = r##"#!/bin/sh
while [ "${1#-}" != "$1" ]; do
    [ "$1" = -o ] && shift
    shift
done
host=$1
shift
if [ "$host" = down ]; then
    echo "ssh: connect to host down port 22: Connection refused" >&2
    exit 255
fi
mkdir -p "FOLDER/$host"
HOME=FOLDER/$host exec env -u TESSERA_TOKEN PATH=/usr/bin:/bin sh -c "$*"
"##;

struct Hosts(tempfile::TempDir);

impl Hosts {
    fn new(list: &str) -> Self {
        let at = tempfile::tempdir().unwrap();
        let ssh = at.path().join("ssh");
        fs::write(&ssh, SSH.replace("FOLDER", at.path().to_str().unwrap())).unwrap();
        fs::set_permissions(&ssh, fs::Permissions::from_mode(0o755)).unwrap();
        fs::write(at.path().join("hosts.txt"), list).unwrap();
        Self(at)
    }

    fn at(&self) -> &Path {
        self.0.path()
    }

    fn render(&self, more: &[&str]) -> Command {
        let demo = scene("demo.xml");
        let fixed = ["render", demo.to_str().unwrap(), "--listen", "127.0.0.1:0", "--progress", "none"];
        let mut command = coordinator(self.at(), fixed.iter().chain(more));
        let path = format!("{}:{}", self.at().display(), std::env::var("PATH").unwrap());
        command.env("PATH", path).env("XDG_STATE_HOME", self.at().join("state")).env_remove("TESSERA_TOKEN");
        command
    }

    /// Workers of a host's own binary that are there.
    fn workers(&self) -> usize {
        let ours = self.at().to_str().unwrap().to_owned();
        let processes = fs::read_dir("/proc").unwrap().filter_map(Result::ok);
        processes
            .filter_map(|p| fs::read(p.path().join("cmdline")).ok())
            .filter(|line| {
                let program = line.split(|&b| b == 0).next().unwrap_or_default();
                let program = String::from_utf8_lossy(program).into_owned();
                program.starts_with(&ours) && program.contains("/worker-")
            })
            .count()
    }

    fn until_none(&self) {
        until("no workers left", || self.workers() == 0);
    }
}

#[test]
fn workers_are_copied_to_hosts_and_render_the_same_picture() {
    let hosts = Hosts::new("a # the first\nann@b\n");
    let view = ["--size", "96x64", "--samples", "4", "--token-file", "token"];
    let fleet = ["--fleet", "ssh:hosts.txt", "--fleet-workers", "2", "--report", "fleet.json"];
    // One binary for both programs' tests: the one beside the coordinator.
    let _ = program("worker");
    let ended: Ended = hosts.render(&[&view[..], &fleet].concat()).output().unwrap().into();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    hosts.until_none();
    let hash = |name: &str| pixels_hash(&hosts.at().join(name));
    let demo = scene("demo.xml");
    let alone = ["render", demo.to_str().unwrap(), "--report", "alone.json", "--progress", "none"];
    assert_eq!(run(hosts.at(), alone.iter().chain(&view[..4])).code, Some(0));
    assert_eq!(hash("fleet.json"), hash("alone.json"));
    let copies = fs::read_dir(hosts.at().join("ann@b/.cache/tessera")).unwrap().count()
        + fs::read_dir(hosts.at().join("a/.cache/tessera")).unwrap().count();
    assert_eq!(copies, 2);
}

#[test]
fn workers_leave_with_their_coordinator_however_it_ends() {
    let hosts = Hosts::new("a\nb\n");
    let long = ["--size", "2000x1500", "--samples", "4096", "--fleet", "ssh:hosts.txt", "--fleet-workers", "2"];
    for signal in ["INT", "KILL"] {
        let running = Running::start(&mut hosts.render(&[&long[..], &["--journal", "none"]].concat()));
        until("workers", || hosts.workers() >= 2);
        running.signal(signal);
        let _ = running.wait();
        // Long before they would give up looking for a coordinator.
        hosts.until_none();
    }
}

#[test]
fn hosts_that_are_not_there_are_named() {
    let hosts = Hosts::new("down\n");
    let fleet = ["--fleet", "ssh:hosts.txt", "--fleet-workers", "1"];
    let ended: Ended = hosts.render(&fleet).output().unwrap().into();
    assert_eq!(ended.code, Some(4), "{}", ended.err);
    assert!(ended.err.contains("Connection refused"), "{}", ended.err);
    let missing: Ended = hosts.render(&["--fleet", "ssh:none.txt", "--fleet-workers", "1"]).output().unwrap().into();
    assert!(missing.code != Some(0) && missing.err.contains("none.txt"), "{}", missing.err);
}
