//! Tokens, certificates and pictures as users of the programs meet them.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use tempfile::{TempDir, tempdir};
use tessera_tests::program::{Ended, Running, coordinator, program, run, scene};

/// `coordinator` of a user whose state is in `home`.
fn of_user<A: AsRef<std::ffi::OsStr>>(home: &TempDir, arguments: impl IntoIterator<Item = A>) -> Command {
    let mut command = coordinator(home.path(), arguments);
    command.env("XDG_STATE_HOME", home.path().join("state")).env_remove("TESSERA_TOKEN");
    command
}

fn token(home: &TempDir, more: &[&str]) -> String {
    let ended: Ended = of_user(home, [&["token"], more].concat()).output().unwrap().into();
    assert_eq!((ended.code, ended.err.as_str()), (Some(0), ""));
    ended.out.trim().to_owned()
}

/// Starts a render that listens beyond loopback, and gives its port.
fn render(home: &TempDir, more: &[&str]) -> (Running, String, String) {
    let demo = scene("demo.xml");
    let common = ["render", demo.to_str().unwrap(), "--size", "160x120", "--listen", "0.0.0.0:0", "--report", "r.json"];
    let mut running = Running::start(&mut of_user(home, [&common, more].concat()));
    let line = running.line(|l| l.contains("awaited on ")).unwrap();
    let port = line.split("awaited on 0.0.0.0:").nth(1).unwrap().split(';').next().unwrap().to_owned();
    (running, port, line)
}

fn worker(port: &str, more: &[&str]) -> Command {
    let mut command = Command::new(program("worker"));
    command.args(["--connect", &format!("127.0.0.1:{port}"), "--once", "--threads", "1"]).args(more);
    command.env_remove("RUST_LOG").env_remove("TESSERA_TOKEN");
    command
}

#[test]
fn the_token_is_made_once_renewed_when_asked_and_kept_from_others() {
    let home = tempdir().unwrap();
    let first = token(&home, &[]);
    assert!(first.starts_with("tessera1."), "{first}");
    assert_eq!(token(&home, &["show"]), first);
    let second = token(&home, &["renew"]);
    assert_ne!(second, first);
    assert_eq!(second.split('.').nth(1), first.split('.').nth(1), "the farm is the same");
    assert_eq!(token(&home, &["show"]), second);
    let folder = home.path().join("state/tessera");
    assert_eq!(std::fs::metadata(&folder).unwrap().permissions().mode() & 0o777, 0o700);
    for file in std::fs::read_dir(folder).unwrap() {
        assert_eq!(file.unwrap().metadata().unwrap().permissions().mode() & 0o777, 0o600);
    }
}

#[test]
fn a_listener_beyond_loopback_takes_whoever_has_the_token_and_tells_it_to_no_log() {
    let home = tempdir().unwrap();
    let known = token(&home, &[]);
    let secret = known.rsplit('.').next().unwrap();
    let (running, port, line) = render(&home, &["-v"]);
    assert!(line.contains("--token-file") && !line.contains(secret), "{line}");
    let title = std::fs::read(format!("/proc/{}/cmdline", running.id())).unwrap();
    assert!(!String::from_utf8_lossy(&title).contains(secret));
    // Neither without a token nor with one that is none, which is not repeated.
    let none: Ended = worker(&port, &[]).output().unwrap().into();
    assert_eq!(none.code, Some(1), "{}", none.err);
    assert!(none.err.contains("--token"), "{}", none.err);
    let bad: Ended = worker(&port, &["--token", "tessera1.AAAA.BBBB"]).output().unwrap().into();
    assert_eq!(bad.code, Some(2), "{}", bad.err);
    assert!(bad.err.contains("--token") && !bad.err.contains("BBBB"), "{}", bad.err);
    let file = home.path().join("token.txt");
    std::fs::write(&file, &known).unwrap();
    let by_file = Running::start(&mut worker(&port, &["--token-file", file.to_str().unwrap(), "-vv"]));
    let (status, said) = by_file.wait();
    assert!(status.success(), "{said}");
    let (status, rest) = running.wait();
    assert!(status.success(), "{rest}");
    let report = std::fs::read_to_string(home.path().join("r.json")).unwrap();
    for text in [&said, &rest, &report] {
        assert!(!text.contains(secret), "{text}");
    }
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!((&report["complete"], &report["refused_calls"]), (&Value::from(true), &Value::from(1)));
}

#[test]
fn a_token_in_the_environment_serves_both_and_insecure_says_what_it_is() {
    let home = tempdir().unwrap();
    let known = token(&home, &[]);
    let (running, port, _) = render(&home, &[]);
    let done: Ended = worker(&port, &[]).env("TESSERA_TOKEN", &known).output().unwrap().into();
    assert_eq!(done.code, Some(0), "{}", done.err);
    assert!(running.wait().0.success());
    let demo = scene("demo.xml");
    let open = ["render", demo.to_str().unwrap(), "--size", "64x48", "--listen", "0.0.0.0:0", "--workers", "1"];
    let insecure: Ended = of_user(&home, [&open[..], &["--insecure"]].concat()).output().unwrap().into();
    assert_eq!(insecure.code, Some(0), "{}", insecure.err);
    assert!(insecure.err.contains("warning") && insecure.err.contains("--insecure"), "{}", insecure.err);
    // A token that belongs to somebody else is no token for this farm.
    let other = tempdir().unwrap();
    let foreign: Ended = of_user(&home, open).env("TESSERA_TOKEN", token(&other, &[])).output().unwrap().into();
    assert_eq!(foreign.code, Some(2), "{}", foreign.err);
    assert!(foreign.err.contains("TESSERA_TOKEN is the token of another farm"), "{}", foreign.err);
}

#[test]
fn half_of_what_makes_a_certificate_is_a_usage_error() {
    let home = tempdir().unwrap();
    let demo = scene("demo.xml");
    for bad in [
        &["--tls-cert", "a.pem"][..],
        &["--tls-key", "a.key"],
        &["--tls-client-ca", "ca.pem"],
        &["--insecure", "--token-file", "t"],
        &["--tls-cert", "missing.pem", "--tls-key", "missing.key"],
        &["--verify", "200%"],
        &["--verify", "some"],
        &["--max-depth", "4294967295"],
    ] {
        let arguments = [&["render", demo.to_str().unwrap(), "--listen", "0.0.0.0:0"], bad].concat();
        let ended: Ended = of_user(&home, arguments).output().unwrap().into();
        assert_eq!(ended.code, Some(2), "{bad:?}: {}", ended.err);
    }
}

#[test]
fn what_was_verified_stands_in_the_report() {
    let home = tempdir().unwrap();
    let demo = scene("demo.xml");
    let arguments = ["render", demo.to_str().unwrap(), "--size", "160x120", "--tile", "16", "--verify", "all"];
    let ended = run(home.path(), [&arguments[..], &["--report", "r.json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let report: Value = serde_json::from_str(&std::fs::read_to_string(home.path().join("r.json")).unwrap()).unwrap();
    let v = &report["verification"];
    assert!(v["compared"].as_u64().unwrap() >= 80 && v["disagreed"] == 0 && v["thrown_out"] == serde_json::json!([]));
    let check = &v["checks"][0];
    assert!(check["made_by"].is_string() && check["checked_by"].is_string() && check["made_by"] != check["checked_by"]);
}

fn with_picture(file: &str) -> String {
    let scene = std::fs::read_to_string(scene("demo.xml")).unwrap();
    let begin = scene.find("file=\"").unwrap() + 6;
    let end = begin + scene[begin..].find('"').unwrap();
    format!("{}{file}{}", &scene[..begin], &scene[end..])
}

/// What `check` says of a scene in `folder` whose picture is `file`.
fn checked(folder: &Path, file: &str, more: &[&str]) -> Ended {
    std::fs::write(folder.join("scene.xml"), with_picture(file)).unwrap();
    run(folder, [&["check", "scene.xml"], more].concat())
}

#[test]
fn pictures_come_from_the_scenes_folder_and_from_where_it_is_allowed() {
    let home = tempdir().unwrap();
    let (inside, outside) = (home.path().join("scenes"), home.path().join("elsewhere"));
    for folder in [&inside, &inside.join("below"), &outside] {
        std::fs::create_dir_all(folder).unwrap();
    }
    let picture = b"P3 1 1 255 1 2 3\n";
    for file in [inside.join("own.ppm"), inside.join("below/own.ppm"), outside.join("other.ppm")] {
        std::fs::write(file, picture).unwrap();
    }
    std::fs::write(outside.join("secret"), "hunter2 is what it says").unwrap();
    std::os::unix::fs::symlink(outside.join("other.ppm"), inside.join("link.ppm")).unwrap();
    for good in ["own.ppm", "below/own.ppm", "below/../own.ppm", inside.join("own.ppm").to_str().unwrap()] {
        assert_eq!(checked(&inside, good, &[]).code, Some(0), "{good}");
    }
    let absolute = outside.join("other.ppm");
    let elsewhere = ["../elsewhere/other.ppm", absolute.to_str().unwrap(), "link.ppm"];
    for bad in elsewhere {
        let ended = checked(&inside, bad, &[]);
        assert_eq!(ended.code, Some(3), "{bad}");
        assert!(ended.err.contains("--allow-pictures"), "{}", ended.err);
        assert_eq!(checked(&inside, bad, &["--allow-pictures", "../elsewhere"]).code, Some(0), "{bad}");
    }
    // Of what lies elsewhere nothing is told: not what is in it, not what it is, not whether it is there.
    let told: Vec<String> =
        ["/etc/passwd", "../elsewhere/secret", "../elsewhere/missing", "/dev/tty", "/nowhere/at/all"]
            .map(|bad| checked(&inside, bad, &[]).err.replace(bad, "X"))
            .map(|err| err.lines().next().unwrap().to_owned())
            .into();
    assert!(told.windows(2).all(|w| w[0] == w[1]), "{told:?}");
    assert!(!told[0].contains("root") && !told[0].contains("hunter"), "{told:?}");
    let missing = checked(&inside, "missing.ppm", &[]);
    assert!(missing.err.contains("no such file"), "{}", missing.err);
}

#[test]
fn text_of_a_scene_does_not_reach_the_terminal_raw() {
    let home = tempdir().unwrap();
    for hostile in ["&#x9b;31m", "&#x202e;", "&#x2028;", "&#xfeff;", "&#xe0041;"] {
        let ended = checked(home.path(), &format!("a{hostile}b.ppm"), &[]);
        assert_eq!(ended.code, Some(3), "{}", ended.err);
        let raw = |c: char| c != '\n' && tessera_core::text::disturbs(c);
        assert!(!ended.err.chars().any(raw), "{:?}", ended.err);
        let json = run(home.path(), ["check", "scene.xml", "--json"]);
        assert!(!json.out.chars().any(raw), "{:?}", json.out);
    }
}
