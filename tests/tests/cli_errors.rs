//! What users get wrong: a clear message, the right exit code, no panic, nothing left behind.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use tempfile::{TempDir, tempdir};
use tessera_tests::program::{Ended, coordinator, run, scene};

fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("the folder is there");
    let mut names: Vec<_> = entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn render_demo(at: &Path, arguments: &[&str]) -> Ended {
    let path = scene("demo.xml");
    run(at, ["render", path.to_str().expect("text")].iter().chain(arguments))
}

/// The program said no, with this code, all of these words, and no trace of a panic.
#[track_caller]
fn refused(ended: &Ended, code: i32, words: &[&str]) {
    assert_eq!(ended.code, Some(code), "{}", ended.err);
    assert!(ended.err.contains("error") && !ended.err.contains("panicked"), "{}", ended.err);
    for word in words {
        assert!(ended.err.contains(word), "'{word}' is not in: {}", ended.err);
    }
}

#[test]
fn arguments_that_make_no_sense_are_usage_errors() {
    let at = tempdir().expect("a folder");
    for (arguments, words) in [
        (&["--size", "0x480"][..], &["--size", "1 to 65536"][..]),
        (&["--size", "640x0"], &["--size", "1 to 65536"]),
        (&["--size", "-640x480"], &["--size", "WIDTHxHEIGHT"]),
        (&["--size", "65537x1"], &["--size", "1 to 65536"]),
        (&["--size", "99999999999999999999999x99999999999999999999999"], &["--size", "1 to 65536"]),
        (&["--size", "640"], &["--size", "WIDTHxHEIGHT"]),
        (&["--zoom", "0"], &["zoom", "above 0"]),
        (&["--zoom", "nan"], &["zoom", "above 0"]),
        (&["--zoom", "-2"], &["zoom", "above 0"]),
        (&["--plane-height", "inf"], &["image plane", "above 0"]),
        (&["--region", "0,0,0,5"], &["--region", "empty"]),
        (&["--region", "5,5,2,9"], &["--region", "empty"]),
        (&["--region", "0,0,641,480"], &["--region 0,0,641,480", "640x480"]),
        (&["--region", "-1,0,5,5"], &["--region", "'-1'"]),
        (&["--samples", "5"], &["samples", "square number"]),
        (&["--samples", "0"], &["samples", "square number"]),
        (&["--samples", "4225"], &["samples", "1 to 4096"]),
        (&["--max-depth", "0"], &["--max-depth"]),
        (&["--workers", "-1"], &["--workers"]),
        (&["--threads", "0"], &["--threads"]),
        (&["--tile", "0"], &["--tile", "1 to 256"]),
        (&["--bits", "12"], &["--bits", "8", "16"]),
        (&["--transfer", "gamma"], &["--transfer", "srgb", "linear"]),
        (&["--listen", "1.2.3.4:99999"], &["--listen", "65535"]),
        (&["--colour"], &["--colour"]),
        (&["-o", "a.jpg"], &["a.jpg", ".png, .ppm, .pfm or .exr"]),
        (&["-o", "a"], &["no extension", ".png"]),
        (&["-o", "."], &[".png"]),
        (&["-o", "nowhere/a.png"], &["nowhere", "does not exist"]),
        (&["--report", "nowhere/r.json"], &["nowhere", "does not exist"]),
    ] {
        let ended = render_demo(at.path(), arguments);
        refused(&ended, 2, words);
        assert!(files(at.path()).is_empty(), "{arguments:?} left {:?}", files(at.path()));
    }
    refused(&run(at.path(), ["render"]), 2, &["<SCENE>"]);
    refused(&run(at.path(), ["rendr"]), 2, &["render"]);
    let nothing = run::<&str>(at.path(), []);
    assert_eq!((nothing.code, nothing.err.contains("Usage")), (Some(2), true));
}

#[test]
fn a_place_that_takes_no_picture_is_known_before_the_scene_is_read() {
    let at = tempdir().expect("a folder");
    std::fs::write(at.path().join("file"), "").expect("written");
    std::fs::create_dir(at.path().join("folder.png")).expect("made");
    // A scene that is not there: had it been looked at first, that would be the error.
    let render = |output: &str| run(at.path(), ["render", "none.xml", "-o", output]);
    refused(&render("file/a.png"), 2, &["is not a folder"]);
    refused(&render("folder.png"), 2, &["exists and is a folder"]);
    if cfg!(target_os = "linux") {
        // Takes no files, not even from root.
        refused(&render("/proc/a.png"), 2, &["cannot write into the folder '/proc'"]);
    }
    assert_eq!(files(at.path()), ["file", "folder.png"]);
}

#[test]
fn an_address_that_cannot_be_listened_on_fails_at_once() {
    let at = tempdir().expect("a folder");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = taken.local_addr().expect("an address").to_string();
    refused(&render_demo(at.path(), &["--listen", &address]), 1, &[&address, "another program listens there"]);
    refused(
        &render_demo(at.path(), &["--listen", "no-such-host.invalid"]),
        1,
        &["no-such-host.invalid", "does not resolve"],
    );
    // An address for documentation: no machine has it.
    refused(&render_demo(at.path(), &["--listen", "192.0.2.1:4747"]), 1, &["192.0.2.1:4747"]);
    assert!(files(at.path()).is_empty());
}

#[test]
fn without_any_worker_the_render_ends() {
    let at = tempdir().expect("a folder");
    let ended = render_demo(at.path(), &["--workers", "0"]);
    refused(&ended, 4, &["no worker for 30 s", "worker --connect"]);
    // It lasted long enough for a journal, from which the same command goes on.
    assert!(files(at.path()).iter().all(|f| f.ends_with(".journal")), "{:?}", files(at.path()));
}

#[test]
fn a_scene_that_is_not_valid_is_marked_where_it_is_wrong() {
    let at = tempdir().expect("a folder");
    let text = std::fs::read_to_string(scene("lights.xml")).expect("a scene");
    std::fs::write(at.path().join("bad.xml"), text.replacen("radius", "radus", 1)).expect("written");
    let ended = run(at.path(), ["render", "bad.xml"]);
    refused(&ended, 3, &["radus", "bad.xml:", "^^^^^", "did you mean `radius`?"]);
    assert_eq!(files(at.path()), ["bad.xml"]);
    refused(&run(at.path(), ["render", "none.xml"]), 3, &["none.xml", "no such file"]);
    refused(&run(at.path(), ["check", "."]), 3, &["folder"]);
    std::fs::write(at.path().join("empty.xml"), "").expect("written");
    refused(&run(at.path(), ["render", "empty.xml"]), 3, &["empty.xml"]);
}

/// demo.xml in a folder of its own, where its picture, globe.ppm, is not there yet.
fn demo_without_picture() -> TempDir {
    let at = tempdir().expect("a folder");
    std::fs::copy(scene("demo.xml"), at.path().join("demo.xml")).expect("copied");
    at
}

#[test]
fn a_picture_that_cannot_be_used_is_an_error_of_the_scene() {
    let at = demo_without_picture();
    let globe = at.path().join("globe.ppm");
    let render = || run(at.path(), ["render", "demo.xml", "--size", "8x6"]);
    refused(&render(), 3, &["globe.ppm", "no such file", "demo.xml:"]);
    std::fs::create_dir(&globe).expect("made");
    refused(&render(), 3, &["globe.ppm", "a directory"]);
    std::fs::remove_dir(&globe).expect("removed");
    for (bytes, why) in [
        (&b"P6 4 4 255\nabc"[..], "truncated"),
        (b"P6 0 4 255\nabc", "empty"),
        (b"P6 99999 99999 255\n", "above the limit"),
        (b"GIF89a", "not with P3 or P6"),
    ] {
        std::fs::write(&globe, bytes).expect("written");
        refused(&render(), 3, &["globe.ppm", why]);
    }
    assert_eq!(files(at.path()), ["demo.xml", "globe.ppm"]);
    std::fs::write(&globe, b"P6 1 1 255\nabc").expect("written");
    assert_eq!(render().code, Some(0));
}

#[cfg(unix)]
#[test]
fn a_fifo_does_not_block() {
    let at = demo_without_picture();
    let made = Command::new("mkfifo").arg(at.path().join("globe.ppm")).arg(at.path().join("fifo.xml")).status();
    assert!(made.expect("mkfifo runs").success());
    refused(&run(at.path(), ["render", "demo.xml"]), 3, &["globe.ppm", "FIFO"]);
    refused(&run(at.path(), ["check", "fifo.xml"]), 3, &["fifo.xml", "not a regular file"]);
}

#[cfg(unix)]
#[test]
fn an_unreadable_picture_is_an_error_of_the_scene() {
    use std::os::unix::fs::PermissionsExt;
    let at = demo_without_picture();
    let globe = at.path().join("globe.ppm");
    std::fs::write(&globe, b"P6 1 1 255\nabc").expect("written");
    std::fs::set_permissions(&globe, std::fs::Permissions::from_mode(0o0)).expect("set");
    if std::fs::read(&globe).is_ok() {
        eprintln!("skipped: this user may read everything");
        return;
    }
    refused(&run(at.path(), ["render", "demo.xml"]), 3, &["globe.ppm", "cannot be read"]);
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let at = tempdir().expect("a folder");
    let path = scene("demo.xml");
    let flags = ["check", path.to_str().expect("text"), "--json"];
    let mut child =
        coordinator(at.path(), flags).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("started");
    drop(child.stdout.take());
    let said: Vec<_> = BufReader::new(child.stderr.take().expect("piped")).lines().map(|l| l.expect("text")).collect();
    assert_eq!((child.wait().expect("waited").code(), said), (Some(0), vec![]));
}
