//! Workers that a batch system starts, as real processes: they come when there is work, and none is left behind.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::Command;

use tessera_tests::engine::FakeSlurm;
use tessera_tests::loopback;
use tessera_tests::program::{Ended, Running, coordinator, pixels_hash, report, run, scene};
use tessera_tests::wait::until;

/// A picture that takes longer than any of these tests.
const LONG: [&str; 4] = ["--size", "2000x1500", "--samples", "4096"];
/// One that does not.
const SHORT: [&str; 4] = ["--size", "96x64", "--samples", "4"];

/// `render demo.xml` with workers from the engine.
fn render(slurm: &FakeSlurm, at: &Path, view: &[&str], more: &[&str]) -> Command {
    let demo = scene("demo.xml");
    let fixed = ["render", demo.to_str().unwrap(), "--listen", "127.0.0.1:0", "--fleet", "slurm", "--progress", "none"];
    let mut command = coordinator(at, fixed.iter().chain(view).chain(more));
    command.env("XDG_STATE_HOME", at.join("state")).env_remove("TESSERA_TOKEN");
    slurm.first_in_path(&mut command);
    command
}

fn ended(mut command: Command) -> Ended {
    command.output().unwrap().into()
}

/// The hash of the short picture as one process renders it.
fn expected(at: &Path) -> String {
    let demo = scene("demo.xml");
    let args = ["render", demo.to_str().unwrap(), "-o", "alone.png", "--report", "alone.json", "--progress", "none"];
    let alone = run(at, args.iter().chain(&SHORT));
    assert_eq!(alone.code, Some(0), "{}", alone.err);
    pixels_hash(&at.join("alone.json"))
}

#[test]
fn a_picture_by_an_engines_workers_is_that_of_one_process_and_nothing_is_left() {
    let (slurm, at) = (FakeSlurm::new(), tempfile::tempdir().unwrap());
    let rendered = ended(render(&slurm, at.path(), &SHORT, &["--fleet-workers", "3", "--report", "fleet.json"]));
    assert_eq!(rendered.code, Some(0), "{}\n{}", rendered.err, slurm.log());
    assert_eq!(slurm.running(), []);
    assert_eq!(pixels_hash(&at.path().join("fleet.json")), expected(at.path()));
    let report = report(&at.path().join("fleet.json"));
    let workers = report["workers"].as_array().unwrap();
    assert!(workers.iter().any(|w| w["name"].as_str().unwrap().starts_with("slurm-")), "{workers:?}");
}

#[test]
fn the_token_reaches_workers_and_no_command_line() {
    let (slurm, at) = (FakeSlurm::new(), tempfile::tempdir().unwrap());
    let guarded = ["--fleet-workers", "1", "--token-file", "token"];
    let mut long = Running::start(&mut render(&slurm, at.path(), &LONG, &guarded));
    // Who joins has the token.
    let joined = long.line(|line| line.contains("slurm-") && line.contains("join"));
    assert!(joined.is_some(), "{}", slurm.log());
    let token = fs::read_to_string(at.path().join("token")).unwrap();
    let tasks = slurm.running();
    assert_eq!(tasks.len(), 1);
    let line = fs::read_to_string(format!("/proc/{}/cmdline", tasks[0].1)).unwrap();
    assert!(line.contains("worker") && !line.contains(token.trim()), "{line}");
    long.signal("INT");
    let (status, _) = long.wait();
    assert_eq!(status.code(), Some(130));
    assert_eq!(slurm.running(), []);
}

#[test]
fn what_the_engine_refuses_is_said_and_ends_the_render() {
    let (slurm, at) = (FakeSlurm::new(), tempfile::tempdir().unwrap());
    let more = ["--fleet-workers", "2", "--fleet-args", "--partition=nowhere"];
    let refused = ended(render(&slurm, at.path(), &SHORT, &more));
    assert_eq!(refused.code, Some(4), "{}", refused.err);
    assert!(refused.err.contains("invalid partition specified: nowhere"), "{}", refused.err);
    assert_eq!(slurm.running(), []);
    // And so is an engine that is not there.
    let mut command = render(&slurm, at.path(), &SHORT, &["--fleet-workers", "2"]);
    command.env("PATH", at.path());
    let refused = ended(command);
    assert_eq!(refused.code, Some(4), "{}", refused.err);
    assert!(refused.err.contains("'sbatch' cannot be run"), "{}", refused.err);
}

#[test]
fn an_interrupted_render_leaves_no_job_behind() {
    let (slurm, at) = (FakeSlurm::new(), tempfile::tempdir().unwrap());
    let long = Running::start(&mut render(&slurm, at.path(), &LONG, &["--fleet-workers", "2"]));
    until("two workers", || slurm.running().len() == 2);
    long.signal("TERM");
    let (status, said) = long.wait();
    assert_eq!(status.code(), Some(130), "{said}");
    assert_eq!(slurm.running(), []);
}

#[test]
fn workers_of_a_coordinator_that_is_killed_leave_by_themselves() {
    let (slurm, at) = (FakeSlurm::new(), tempfile::tempdir().unwrap());
    let more = ["--fleet-workers", "2", "--fleet-give-up-after", "1s"];
    let mut long = Running::start(&mut render(&slurm, at.path(), &LONG, &more));
    assert!(long.line(|line| line.contains("slurm-") && line.contains("join")).is_some());
    until("two workers", || slurm.running().len() == 2);
    long.signal("KILL");
    let _ = long.wait();
    until("they have left", || slurm.running().is_empty());
}

/// A farm that stays, and its workers' engine.
struct Farm {
    slurm: FakeSlurm,
    at: tempfile::TempDir,
    addr: String,
}

impl Farm {
    /// One that has no fleet yet.
    fn new() -> Self {
        let addr = loopback::free().to_string();
        Self { slurm: FakeSlurm::new(), at: tempfile::tempdir().unwrap(), addr }
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = coordinator(self.at.path(), args);
        command.env("XDG_STATE_HOME", self.at.path().join("state")).env_remove("TESSERA_TOKEN");
        self.slurm.first_in_path(&mut command);
        command
    }

    fn serve(&self, more: &[&str]) -> Running {
        let args = ["serve", "--state", "farm", "--listen", &self.addr, "--http", "none"];
        let mut serve = Running::start(&mut self.command(&[&args[..], more].concat()));
        assert!(serve.line(|line| line.contains("submit jobs by")).is_some());
        serve
    }

    fn ok(&self, args: &[&str]) -> String {
        let ended: Ended = self.command(&[args, &["--farm", &self.addr]].concat()).output().unwrap().into();
        assert_eq!(ended.code, Some(0), "{args:?}: {}\n{}", ended.err, self.slurm.log());
        ended.out.trim().to_owned()
    }

    fn submit(&self, view: &[&str], more: &[&str]) -> String {
        self.ok(&[&["submit", scene("demo.xml").to_str().unwrap()], view, more].concat())
    }
}

#[test]
fn workers_come_with_work_and_go_without() {
    let farm = Farm::new();
    let sizes = ["--fleet", "slurm", "--fleet-workers", "0..3", "--fleet-worth", "1s", "--fleet-idle", "1s"];
    let mut serve = farm.serve(&sizes);
    assert_eq!(farm.slurm.running(), []);
    let long = farm.submit(&LONG, &[]);
    // The first finds out how much there is to do.
    assert!(serve.line(|line| line.contains("slurm is asked for a worker")).is_some());
    until("three workers", || farm.slurm.running().len() == 3);
    // One that somebody else ends is replaced.
    let (victim, _) = farm.slurm.running()[0].clone();
    let cancelled = Command::new(farm.slurm.folder().join("scancel")).arg(&victim).status().unwrap();
    assert!(cancelled.success());
    until("another in its place", || {
        let tasks = farm.slurm.running();
        tasks.len() == 3 && tasks.iter().all(|(name, _)| *name != victim)
    });
    farm.ok(&["cancel", &long]);
    until("none without work", || farm.slurm.running().is_empty());
    let short = farm.submit(&SHORT, &["--wait"]);
    farm.ok(&["fetch", &short, "-o", "fetched.pfm"]);
    let demo = scene("demo.xml");
    let alone = ["render", demo.to_str().unwrap(), "-o", "alone.pfm", "--progress", "none"];
    assert_eq!(run(farm.at.path(), alone.iter().chain(&SHORT)).code, Some(0));
    let bytes = |name: &str| fs::read(farm.at.path().join(name)).unwrap();
    assert!(bytes("fetched.pfm") == bytes("alone.pfm"));
    serve.signal("TERM");
    let (_, said) = serve.wait();
    assert_eq!(farm.slurm.running(), [], "{said}");
}

#[test]
fn a_fleet_can_be_had_for_a_farm_that_runs_and_ends_without_it() {
    let farm = Farm::new();
    let fleet = ["fleet", "slurm", "--connect", &farm.addr, "--fleet-workers", "0..2", "--fleet-give-up-after", "2s"];
    let lonely: Ended = farm.command(&fleet).output().unwrap().into();
    assert_eq!(lonely.code, Some(1), "{}", lonely.err);
    let serve = farm.serve(&[]);
    let beside = Running::start(&mut farm.command(&fleet));
    farm.submit(&SHORT, &["--wait"]);
    serve.signal("KILL");
    let _ = serve.wait();
    let (status, said) = beside.wait();
    assert_eq!(status.code(), Some(0), "{said}");
    assert_eq!(farm.slurm.running(), []);
}

#[test]
fn what_is_printed_is_what_can_be_submitted_by_hand() {
    let farm = Farm::new();
    let print = ["fleet", "slurm", "--connect", &farm.addr, "--fleet-workers", "2", "--fleet-give-up-after", "2s"];
    let mut command = farm.command(&[&print[..], &["--print"]].concat());
    // Neither a farm nor an engine is there.
    command.env("PATH", farm.at.path());
    let printed: Ended = command.output().unwrap().into();
    assert_eq!((printed.code, printed.err.as_str()), (Some(0), ""));
    assert!(printed.out.starts_with("#!/bin/sh\n#SBATCH "), "{}", printed.out);
    assert_eq!(fs::read_dir(farm.at.path()).unwrap().count(), 0);
    assert_eq!(farm.slurm.running(), []);

    let serve = farm.serve(&[]);
    let script = farm.at.path().join("script");
    fs::write(&script, printed.out).unwrap();
    let submitted =
        Command::new(farm.slurm.folder().join("sbatch")).stdin(fs::File::open(script).unwrap()).output().unwrap();
    assert!(submitted.status.success());
    farm.submit(&SHORT, &["--wait"]);
    serve.signal("KILL");
    let _ = serve.wait();
    until("they have left", || farm.slurm.running().is_empty());
}

#[test]
fn flags_of_a_fleet_say_what_they_miss() {
    let at = tempfile::tempdir().unwrap();
    let demo = scene("demo.xml");
    let render = |more: &[&str]| run(at.path(), ["render", demo.to_str().unwrap()].iter().chain(more));
    for (args, why) in [
        (&["--fleet", "slurm", "--fleet-workers", "2"][..], "--listen"),
        (&["--fleet", "slurm", "--listen", "127.0.0.1:0"], "--fleet-workers"),
        (&["--fleet", "sge", "--fleet-workers", "2", "--listen", "127.0.0.1:0"], "slurm, pbs"),
        (&["--fleet-workers", "2"], "--fleet slurm"),
        (&["--fleet", "slurm", "--fleet-workers", "3..2", "--listen", "127.0.0.1:0"], "0..64"),
    ] {
        let ended = render(args);
        assert_eq!(ended.code, Some(2), "{args:?}: {}", ended.err);
        assert!(ended.err.contains(why), "{args:?}: {}", ended.err);
    }
}
