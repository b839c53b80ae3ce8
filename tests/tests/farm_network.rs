//! The programs on hosts of their own, over lines that are slow, lossy, cut, or open in one direction only.
//!
//! Needs Linux, root, and `ip` and `tc`; where they are missing each test says so and is skipped.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(target_os = "linux")]

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;
use tempfile::{TempDir, tempdir};
use tessera_tests::network::{Fault, Network};
use tessera_tests::program::{Running, coordinator, program, run, scene};

/// Seconds of one thread.
const LONG: &str = "--size 240x180 --samples 100 --tile 16";
/// What even a slow line carries in a few seconds.
const SHORT: &str = "--size 160x120 --samples 16 --tile 16";

struct Farm {
    at: TempDir,
    coordinator: Running,
    workers: Vec<Running>,
    // Last: hosts go after what runs on them.
    network: Network,
}

/// A coordinator on host 1, and a worker on each of the others; `None` where that cannot be had.
fn farm(workers: usize, flags: &str, before: &[(usize, Fault)]) -> Option<Farm> {
    let made = Network::new(1 + workers).and_then(|mut network| {
        before.iter().try_for_each(|&(host, fault)| network.fault(host, fault)).map(|()| network)
    });
    let network = match made {
        Ok(network) => network,
        Err(why) => {
            println!("skipped: no network of namespaces here ({why})");
            return None;
        }
    };
    let at = tempdir().unwrap();
    let state = at.path().join("state");
    let demo = scene("mirrors.xml");
    let listen = format!("{}:4747", Network::address(1));
    let mut command = coordinator(at.path(), ["render", demo.to_str().unwrap(), "-o", "farm.pfm"]);
    command.args(flags.split(' ')).args(["--listen", &listen, "--progress", "json", "--journal", "none"]);
    command.env("XDG_STATE_HOME", &state);
    let token = coordinator(at.path(), ["token"]).env("XDG_STATE_HOME", &state).output().unwrap();
    let token = String::from_utf8(token.stdout).unwrap().trim().to_owned();
    let coordinator = Running::start(network.on(1, &command).stdout(Stdio::null()));
    let worker = |host: usize| {
        let mut command = Command::new(program("worker"));
        command.args(["--connect", &listen, "--threads", "1", "--name", &format!("w{host}"), "--once"]);
        command.env("TESSERA_TOKEN", &token);
        Running::start(network.on(host, &command).stdout(Stdio::null()))
    };
    let workers = (2..2 + workers).map(worker).collect();
    Some(Farm { at, coordinator, workers, network })
}

impl Farm {
    /// Waits until a share of the picture is done.
    fn at_share(&mut self, share: f64) {
        let done = |line: &str| {
            let line: Value = serde_json::from_str(line).unwrap_or_default();
            let number = |key: &str| line[key].as_f64().unwrap_or(0.0);
            number("pixels_done") >= share * number("pixels_total").max(1.0)
        };
        assert!(self.coordinator.line(done).is_some(), "the render ended before");
    }

    /// Waits for the picture, which must be that of a quiet run.
    fn ends_well(self, flags: &str) {
        let Self { at, coordinator, workers, network } = self;
        let (status, said) = coordinator.wait();
        assert!(status.success(), "{said}");
        drop((workers, network));
        let quiet = ["render", scene("mirrors.xml").to_str().unwrap(), "-o", "quiet.pfm"].map(str::to_owned);
        let ended = run(at.path(), quiet.into_iter().chain(flags.split(' ').map(str::to_owned)));
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        let picture = |name: &str| std::fs::read(Path::new(at.path()).join(name)).unwrap();
        assert!(picture("farm.pfm") == picture("quiet.pfm"), "other pixels");
    }
}

#[test]
fn a_long_and_lossy_line_is_no_reason_to_stop() {
    let fault = Fault::Delay { milliseconds: 200, loss: 2 };
    let Some(farm) = farm(1, SHORT, &[(2, fault)]) else { return };
    farm.ends_well(SHORT);
}

#[test]
fn a_line_of_one_megabit_stalls_nobody() {
    let Some(farm) = farm(2, SHORT, &[(2, Fault::Rate(1000))]) else { return };
    farm.ends_well(SHORT);
    let Some(farm) = self::farm(1, SHORT, &[(2, Fault::Rate(1000))]) else { return };
    farm.ends_well(SHORT);
}

#[test]
fn a_worker_that_is_not_heard_any_more_holds_nothing_up() {
    let Some(mut farm) = farm(2, LONG, &[]) else { return };
    farm.at_share(0.1);
    farm.network.fault(2, Fault::Mute).unwrap();
    farm.ends_well(LONG);
}

#[test]
fn a_worker_that_hears_nothing_any_more_holds_nothing_up() {
    let Some(mut farm) = farm(2, LONG, &[]) else { return };
    farm.at_share(0.1);
    farm.network.fault(2, Fault::Deaf).unwrap();
    farm.ends_well(LONG);
}

#[test]
fn a_line_that_is_cut_and_healed_is_dialled_again() {
    let Some(mut farm) = farm(1, LONG, &[]) else { return };
    farm.at_share(0.1);
    farm.network.fault(2, Fault::Cut).unwrap();
    // Until both sides have given up on the other.
    assert!(farm.coordinator.line(|l| l.contains("w2 left")).is_some());
    assert!(farm.workers[0].line(|l| l.contains("trying again")).is_some());
    farm.network.heal(2).unwrap();
    farm.ends_well(LONG);
}

#[test]
fn the_coordinators_own_line_is_cut_and_healed() {
    let Some(mut farm) = farm(2, LONG, &[]) else { return };
    farm.at_share(0.1);
    farm.network.fault(1, Fault::Cut).unwrap();
    std::thread::sleep(Duration::from_secs(1));
    farm.network.heal(1).unwrap();
    farm.ends_well(LONG);
}
