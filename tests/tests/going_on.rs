//! Renders that are killed, interrupted and refused, and go on.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;
use tempfile::{TempDir, tempdir};
use tessera_core::film::file::{Stored, read};
use tessera_tests::generate::Random;
use tessera_tests::journal::Contents;
use tessera_tests::loopback;
use tessera_tests::process::Process;
use tessera_tests::program::{Ended, Running, coordinator, report, run, scene};
use tessera_tests::wait::until;

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect()
}

fn set<const N: usize>(names: [&str; N]) -> BTreeSet<String> {
    names.map(String::from).into()
}

/// `render` of a scene of the repository, its output and flags.
fn command(at: &Path, of: &str, flags: &str) -> Command {
    let path = scene(of);
    let mut command = coordinator(at, ["render", path.to_str().unwrap()]);
    command.args(flags.split_whitespace());
    command
}

/// Starts a render and waits until its journal holds something.
fn begin(at: &TempDir, of: &str, flags: &str, journal: &str) -> Running {
    let mut command = command(at.path(), of, flags);
    let running = Running::start(command.args(["--progress", "json"]).stdout(Stdio::null()));
    let path = at.path().join(journal);
    until("a journal", || !Contents::read(&path).tiles.is_empty());
    running
}

fn kill(running: Running) {
    running.signal("KILL");
    let _ = running.wait();
}

fn picture(at: &TempDir, name: &str) -> Stored {
    read(&at.path().join(name)).unwrap()
}

/// More than any test renders, and not too dear to be gone on with.
const LONG: &str = "-o long.png --size 2000x2000 --samples 256 --tile 16 --threads 2";

/// Times that each of the five jobs is killed; more of them where someone has the time.
fn kills() -> u32 {
    std::env::var("TESSERA_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(40)
}

/// Kills a render at random instants and lets it go on each time; its end must be the quiet run's. Where it comes to an
/// end before it was killed often enough, it begins anew.
fn survives(of: &str, flags: &str, seed: u64) {
    let (mut killed, mut seed) = (0, seed << 32);
    while killed < kills() {
        killed += survives_once(of, flags, seed, kills() - killed);
        seed += 1;
    }
}

fn survives_once(of: &str, flags: &str, seed: u64, kills: u32) -> u32 {
    let at = tempdir().unwrap();
    let quiet = run_to_end(at.path(), of, &format!("{flags} -o quiet.pfm --report quiet.json --journal none"));
    assert_eq!(quiet.code, Some(0), "{}", quiet.err);
    let flags = format!("{flags} -o a.pfm --report a.json");
    kill(begin(&at, of, &flags, "a.pfm.journal"));
    let journal = at.path().join("a.pfm.journal");
    let (mut random, mut before) = (Random::new(seed), Contents::read(&journal));
    let mut killed = 1;
    while killed < kills {
        let mut child = command(at.path(), of, &flags).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_micros(10_000 + random.below(240_000)));
        child.kill().unwrap();
        if child.wait().unwrap().code().is_some() {
            // It was done before it could be killed.
            break;
        }
        killed += 1;
        let now = Contents::read(&journal);
        // Nothing that was kept is lost, nothing of it done again.
        assert!(now.tiles.starts_with(&before.tiles) && now.passed.starts_with(&before.passed), "kill {killed}");
        assert!(now.pixels() >= before.pixels(), "kill {killed}");
        before = now;
    }
    let (kept, tiles) = (before.pixels(), before.tiles.len());
    println!("{of}: killed {killed} times, {tiles} tiles and {kept} pixels kept before the last run");
    if journal.exists() {
        let last = run_to_end(at.path(), of, &flags);
        assert_eq!(last.code, Some(0), "{}", last.err);
        assert!(last.err.contains("going on: "), "{}", last.err);
        let report = report(&at.path().join("a.json"));
        assert_eq!(report["earlier"]["tiles"].as_u64(), Some(tiles as u64));
    }
    let (a, quiet) = (report(&at.path().join("a.json")), report(&at.path().join("quiet.json")));
    for key in ["pixels_sha256", "complete"] {
        assert_eq!(a[key], quiet[key], "{key}");
    }
    // Every tile is in once. Adaptive ones take a few rays more along their edges, and these are cut otherwise.
    if flags.contains("--samples") {
        assert_eq!(a["rays"]["camera"], quiet["rays"]["camera"]);
    }
    for key in ["estimated_rmse", "passes"] {
        assert_eq!(a["accuracy"][key], quiet["accuracy"][key], "{key}");
    }
    assert_eq!(std::fs::read(at.path().join("a.pfm")).unwrap(), std::fs::read(at.path().join("quiet.pfm")).unwrap());
    assert_eq!(names(at.path()), set(["a.json", "a.pfm", "quiet.json", "quiet.pfm"]));
    killed
}

fn run_to_end(at: &Path, of: &str, flags: &str) -> Ended {
    command(at, of, flags).output().unwrap().into()
}

#[test]
fn a_uniform_render_survives_being_killed_again_and_again() {
    survives("demo.xml", "--size 480x360 --samples 400 --threads 2", 1);
}

#[test]
fn an_adaptive_render_survives_being_killed_again_and_again() {
    survives("mirrors.xml", "--size 320x240 --quality final --threads 2", 2);
}

#[test]
fn a_render_towards_an_error_survives_being_killed_again_and_again() {
    survives("mirrors.xml", "--size 240x180 --max-error 0.3 --threads 2", 3);
}

#[test]
fn a_render_within_a_time_survives_being_killed_again_and_again() {
    survives("mirrors.xml", "--size 240x180 --time-limit 2h --max-error 0.3 --threads 2", 4);
}

#[test]
fn a_verified_render_survives_being_killed_again_and_again() {
    survives("demo.xml", "--size 480x360 --samples 400 --threads 2 --verify 1/4", 5);
}

#[test]
fn time_that_was_rendered_for_counts_against_the_limit() {
    let at = tempdir().unwrap();
    let flags = "-o a.png --size 1500x1500 --time-limit 5s --tile 32 --threads 2";
    kill(begin(&at, "mirrors.xml", flags, "a.png.journal"));
    let last = Contents::read(&at.path().join("a.png.journal")).tiles.last().unwrap().at_us;
    assert!((1_000_000..5_000_000).contains(&last), "{last}");
    let ended = run_to_end(at.path(), "mirrors.xml", &format!("{flags} --report -"));
    // Another depth of pixels: the report asks for floats.
    assert_eq!(ended.code, Some(2), "{}", ended.err);
    let ended = run_to_end(at.path(), "mirrors.xml", flags);
    assert!(matches!(ended.code, Some(0 | 5)), "{}", ended.err);
    assert_eq!(names(at.path()), set(["a.png"]));
}

#[test]
fn an_interrupt_keeps_the_journal_and_the_same_command_goes_on() {
    for signal in ["INT", "TERM", "HUP", "QUIT"] {
        if signal == "HUP" && ignores_hangups() {
            println!("HUP is left out: it is ignored here, and so by whatever is started from here");
            continue;
        }
        let at = tempdir().unwrap();
        let running = begin(&at, "demo.xml", LONG, "long.png.journal");
        running.signal(signal);
        let (status, said) = running.wait();
        assert_eq!(status.code(), Some(130), "{signal}: {said}");
        assert!(said.contains("the same command goes on from what is kept in 'long.png.journal'"), "{said}");
        assert_eq!(names(at.path()), set(["long.partial.png", "long.png.journal"]));
        let kept = Contents::read(&at.path().join("long.png.journal"));
        let mut again = Running::start(command(at.path(), "demo.xml", LONG).args(["--progress", "plain"]));
        let line = again.line(|_| true).unwrap();
        assert!(line.starts_with("going on: "), "{line}");
        kill(again);
        let now = Contents::read(&at.path().join("long.png.journal"));
        assert!(now.tiles.starts_with(&kept.tiles));
    }
}

#[test]
fn what_an_interrupt_left_is_gone_once_the_picture_is_whole() {
    let at = tempdir().unwrap();
    let flags = "-o a.png --size 480x360 --samples 400 --tile 16 --threads 2";
    let running = begin(&at, "demo.xml", flags, "a.png.journal");
    running.signal("INT");
    let (status, said) = running.wait();
    if status.code() == Some(130) {
        assert_eq!(names(at.path()), set(["a.partial.png", "a.png.journal"]), "{said}");
        let ended = run_to_end(at.path(), "demo.xml", flags);
        assert_eq!(ended.code, Some(0), "{}", ended.err);
    }
    assert_eq!(names(at.path()), set(["a.png"]));
}

#[test]
fn a_terminal_that_is_closed_is_an_interrupt() {
    let mut trial = Command::new("script");
    let trial = trial.args(["-qec", "true", "/dev/null"]).stdin(Stdio::null()).stdout(Stdio::null()).status();
    if !trial.is_ok_and(|status| status.success()) || ignores_hangups() {
        println!("left out: there is no 'script' here to make a terminal with, or hangups are ignored");
        return;
    }
    let at = tempdir().unwrap();
    let program = tessera_tests::program::program("coordinator");
    let render = format!("exec {} render {} {LONG}", program.display(), scene("demo.xml").display());
    let mut terminal = Command::new("script");
    terminal.args(["-qec", &render, "/dev/null"]).current_dir(at.path()).stdin(Stdio::null()).stdout(Stdio::null());
    let mut terminal = terminal.spawn().unwrap();
    let (journal, partial) = (at.path().join("long.png.journal"), at.path().join("long.partial.png"));
    until("a journal", || !Contents::read(&journal).tiles.is_empty());
    terminal.kill().unwrap();
    terminal.wait().unwrap();
    until("the picture of what is done", || partial.exists());
    assert!(journal.exists());
    assert_eq!(picture(&at, "long.partial.png").image.width(), 2000);
}

/// Waits until `so`.
/// Whether this process was started under `nohup` or the like.
fn ignores_hangups() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask & 1 == 1)
}

#[test]
fn what_nohup_protects_a_closed_terminal_does_not_end() {
    let at = tempdir().unwrap();
    let program = tessera_tests::program::program("coordinator");
    let script = format!(
        "trap '' HUP; exec {} render {} {LONG} --progress json",
        program.display(),
        scene("demo.xml").display()
    );
    let mut shell = Command::new("sh");
    let mut running = Running::start(shell.args(["-c", &script]).current_dir(at.path()).stdout(Stdio::null()));
    assert!(running.line(|l| l.contains("\"progress\"")).is_some());
    running.signal("HUP");
    assert!(running.line(|l| l.contains("\"progress\"")).is_some(), "it ended");
    running.signal("TERM");
    let (status, said) = running.wait();
    assert_eq!(status.code(), Some(130), "{said}");
}

#[test]
fn what_is_not_the_same_is_refused_by_name_and_restart_begins_anew() {
    let at = tempdir().unwrap();
    for name in ["demo.xml", "globe.ppm"] {
        std::fs::copy(scene(name), at.path().join(name)).unwrap();
    }
    let render = |flags: &str| {
        let flags = format!("render demo.xml -o a.png {flags}");
        coordinator(at.path(), flags.split_whitespace())
    };
    let flags = "--size 1200x900 --samples 256 --threads 2";
    let mut running = Running::start(render(flags).args(["--progress", "json"]));
    let journal = at.path().join("a.png.journal");
    assert!(running.line(|_| !Contents::read(&journal).tiles.is_empty()).is_some());
    kill(running);
    let kept = std::fs::read(&journal).unwrap();
    let refused = |flags: &str, words: &[&str]| {
        let ended: Ended = render(flags).output().unwrap().into();
        assert_eq!(ended.code, Some(2), "{flags}: {}", ended.err);
        for word in words.iter().chain(&["--restart", "a.png.journal"]) {
            assert!(ended.err.contains(word), "{flags}: '{word}' is not in: {}", ended.err);
        }
        assert_eq!(std::fs::read(&journal).unwrap(), kept, "{flags}: the journal was touched");
    };
    refused("--size 1200x901 --samples 256", &["--size (1200x900 there, 1200x901 now)"]);
    refused("--size 1200x900 --samples 225", &["--samples 256 there, --samples 225 now"]);
    refused("--size 1200x900 --samples 256 --max-depth 3", &["--max-depth (16 there, 3 now)"]);
    refused("--size 1200x900 --samples 256 --region 0,0,9,9", &["--region"]);
    refused("--size 1200x900 --samples 256 --bits 16", &["the depth of pixels (8 bits there, 16 bits now"]);
    let globe = std::fs::read(at.path().join("globe.ppm")).unwrap();
    let mut other = globe.clone();
    *other.last_mut().unwrap() ^= 1;
    std::fs::write(at.path().join("globe.ppm"), &other).unwrap();
    refused(flags, &["other are: the scene's pictures."]);
    std::fs::write(at.path().join("globe.ppm"), &globe).unwrap();
    let text = std::fs::read_to_string(at.path().join("demo.xml")).unwrap();
    std::fs::write(at.path().join("demo.xml"), text.replacen("radius=\"", "radius=\"1", 1)).unwrap();
    refused(flags, &["other are: the scene."]);
    std::fs::write(at.path().join("demo.xml"), text).unwrap();
    // As it was, it goes on; with --restart, with other settings, it does not.
    let mut running = Running::start(&mut render(flags));
    assert!(running.line(|l| l.contains("going on: ")).is_some());
    kill(running);
    let ended: Ended = render("--size 30x20 --restart").output().unwrap().into();
    assert_eq!((ended.code, ended.err.contains("going on")), (Some(0), false), "{}", ended.err);
    assert_eq!(names(at.path()), set(["a.png", "demo.xml", "globe.ppm"]));
}

#[test]
fn the_picture_so_far_can_be_seen_at_any_moment() {
    let at = tempdir().unwrap();
    let running = begin(&at, "demo.xml", LONG, "long.png.journal");
    let see = |flags: &str| {
        let ended = run(at.path(), ["picture", "long.png.journal"].into_iter().chain(flags.split(' ')));
        assert_eq!(ended.code, Some(0), "{}", ended.err);
    };
    see("-o a.png");
    running.signal("KILL");
    let _ = running.wait();
    see("-o b.png");
    see("-o c.ppm --missing #00ff01");
    let bytes = std::fs::read(at.path().join("b.png")).unwrap();
    // Colour type 6 of the header: what is missing is transparent.
    assert_eq!(bytes[25], 6);
    let (b, c) = (picture(&at, "b.png").image, picture(&at, "c.ppm").image);
    assert_eq!((b.width(), b.height()), (2000, 2000));
    let missing = [0.0, 1.0, 1.0 / 255.0];
    let gone = c.pixels().iter().filter(|p| **p == missing).count();
    let kept = Contents::read(&at.path().join("long.png.journal")).pixels();
    assert_eq!(gone as u64, 2000 * 2000 - kept);
    assert!(b.pixels().iter().zip(c.pixels()).all(|(b, c)| b == c || *c == missing));
    let refused = |flags: &str, words: &str| {
        let ended = run(at.path(), ["picture"].into_iter().chain(flags.split(' ')));
        assert!(matches!(ended.code, Some(1 | 2)) && ended.err.contains(words), "{}", ended.err);
    };
    refused("long.png.journal -o d.exr", "pixels of 8 bits");
    refused("long.png.journal -o d.png --bits 16", "pixels of 8 bits");
    refused("b.png -o d.png", "is no journal");
    refused("none.journal -o d.png", "none.journal");
    // Beside what the killed render left hidden, which the next one clears away.
    let seen: BTreeSet<String> = names(at.path()).into_iter().filter(|n| !n.starts_with('.')).collect();
    assert_eq!(seen, set(["a.png", "b.png", "c.ppm", "long.png.journal"]));
}

#[test]
fn a_coordinator_that_comes_back_finds_its_workers_and_they_have_the_scene() {
    let at = tempdir().unwrap();
    let port = loopback::free();
    let flags = format!("{LONG} --listen {port} --workers 0");
    let connect = port.to_string();
    let mut worker = Process::start("worker", &["--connect", &connect, "--threads", "2", "-v"]);
    kill(begin(&at, "demo.xml", &flags, "long.png.journal"));
    worker.says("registered");
    let kept = Contents::read(&at.path().join("long.png.journal")).pixels();
    let mut again = Running::start(command(at.path(), "demo.xml", &flags).args(["--progress", "json"]));
    let began = std::time::Instant::now();
    let more = again.line(|l| {
        let line: Value = serde_json::from_str(l).unwrap_or_default();
        line["pixels_done"].as_u64().is_some_and(|n| n > kept)
    });
    assert!(more.is_some(), "the render ended");
    worker.says("the scene is here already");
    println!("going on after {:.1?}", began.elapsed());
    worker.signal(Signal::TERM);
    again.signal("TERM");
    let _ = again.wait();
}
