//! What becomes of a program whose stdout or stderr is closed, full or somebody else's: it ends nothing, and it is
//! no success where results are lost.

#![cfg(target_os = "linux")]

use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};

use tempfile::tempdir;
use tessera_tests::process::Process;
use tessera_tests::program::{self, coordinator, run, scene};

/// A device that takes nothing.
fn full() -> Stdio {
    File::options().write(true).open("/dev/full").expect("a full device").into()
}

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

fn demo() -> String {
    scene("demo.xml").to_str().expect("text").to_owned()
}

#[test]
fn a_picture_is_rendered_though_nobody_can_hear_about_it() {
    for (name, stderr) in [("full", full as fn() -> Stdio), ("closed", closed)] {
        for verbose in ["-v", "-vvv", "--progress=bar", "--progress=json"] {
            let at = tempdir().expect("a folder");
            let arguments = ["render", &demo(), "-o", "a.png", "--size", "64x48", verbose];
            let ended = coordinator(at.path(), arguments).stderr(stderr()).stdout(Stdio::null()).status();
            assert_eq!(ended.expect("it starts").code(), Some(0), "{name} {verbose}");
            assert!(at.path().join("a.png").exists());
        }
    }
}

#[test]
fn an_error_that_nobody_can_hear_keeps_its_exit_code() {
    let at = tempdir().expect("a folder");
    for stderr in [full(), closed()] {
        let ended = coordinator(at.path(), ["render", "none.xml", "-v"]).stderr(stderr).status();
        assert_eq!(ended.expect("it starts").code(), Some(3));
    }
}

#[test]
fn results_that_cannot_be_written_are_no_success() {
    let at = tempdir().expect("a folder");
    let done = run(at.path(), ["render", &demo(), "-o", "a.png", "--size", "16x12"]);
    assert_eq!(done.code, Some(0), "{}", done.err);
    for arguments in [
        &["check", &demo(), "--json"][..],
        &["check", &demo()],
        &["compare", "a.png", "a.png"],
        &["compare", "a.png", "a.png", "--json"],
        &["render", &demo(), "-o", "b.png", "--size", "16x12", "--report", "-"],
        &["completions", "bash"],
        &["--help"],
        &["render", "--help"],
        &["--version"],
    ] {
        let ended =
            coordinator(at.path(), arguments).stdout(full()).stderr(Stdio::piped()).output().expect("it starts");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(said.contains("stdout") && !said.contains("panicked"), "{arguments:?}: {said}");
        // Whoever closes a pipe does not want the rest.
        let ended =
            coordinator(at.path(), arguments).stdout(closed()).stderr(Stdio::piped()).output().expect("it starts");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(0), "{arguments:?}: {said}");
    }
}

fn worker(arguments: &[&str], stderr: Stdio) -> std::process::Child {
    let mut command = Command::new(program::program("worker"));
    command.args(arguments).env_remove("RUST_LOG").stdin(Stdio::null()).stdout(Stdio::null()).stderr(stderr);
    command.spawn().expect("it starts")
}

#[test]
fn a_worker_s_help_that_cannot_be_written_is_no_success() {
    for argument in ["--help", "--version"] {
        let mut command = Command::new(program::program("worker"));
        command.arg(argument).stdin(Stdio::null()).stderr(Stdio::null());
        assert_eq!(command.stdout(full()).status().expect("it starts").code(), Some(1), "{argument}");
        assert_eq!(command.stdout(closed()).status().expect("it starts").code(), Some(0), "{argument}");
    }
}

#[test]
fn a_worker_that_nobody_can_hear_dials_on_and_works() {
    for stderr in [full(), closed()] {
        let free = std::net::TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
        // It warns that nobody is there, before there is.
        let mut worker = worker(&["--connect", &free.to_string(), "--once", "-v"], stderr);
        std::thread::sleep(std::time::Duration::from_millis(500));
        assert!(worker.try_wait().expect("asked").is_none(), "it ended at its first warning");
        let at = tempdir().expect("a folder");
        let listen = free.to_string();
        let done = run(at.path(), ["render", &demo(), "-o", "a.png", "--size", "64x48", "--listen", &listen]);
        assert_eq!(done.code, Some(0), "{}", done.err);
        let _ = worker.kill();
        let _ = worker.wait();
    }
}

#[test]
fn logs_are_for_people() {
    let at = tempdir().expect("a folder");
    let (scene, output) = (demo(), at.path().join("a.png"));
    let output = output.to_str().expect("text");
    let mut farm = Process::start(
        "coordinator",
        &["render", &scene, "-o", output, "--size", "640x480", "--listen", "127.0.0.1:0", "-vv"],
    );
    let said = farm.says("awaited on ");
    let address = said.split("awaited on ").nth(1).and_then(|s| s.split(';').next()).expect("an address").to_owned();
    let worker = Process::start("worker", &["--connect", &address, "--name", "bert", "--once", "-vv"]);
    let (status, said) = farm.end();
    assert!(status.success(), "{said}");
    let (_, heard) = worker.end();
    for text in [&said, &heard] {
        assert!(!text.contains('\u{1b}'), "colour: {text}");
        assert!(!text.contains("h2::") && !text.contains("hyper"), "other people's layers: {text}");
    }
    assert!(said.contains("bert joined with"), "{said}");
    quiet_default(at.path(), &scene);
}

/// Without any word about it, who joins is said, and nothing else.
fn quiet_default(at: &Path, scene: &str) {
    let ended = run(at, ["render", scene, "-o", "b.png", "--size", "64x48"]);
    let lines: Vec<&str> = ended.err.lines().collect();
    assert!(lines.len() == 2 && lines[1].starts_with("error (RMSE):"), "{}", ended.err);
}
