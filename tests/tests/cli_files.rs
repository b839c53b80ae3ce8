//! What becomes of files: nothing that is read is overwritten, and no finished picture is thrown away.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::collections::BTreeSet;
use std::path::Path;

use tempfile::{TempDir, tempdir};
use tessera_core::film::file::read;
use tessera_tests::program::{Ended, Running, coordinator, run, scene};

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect()
}

fn set<const N: usize>(names: [&str; N]) -> BTreeSet<String> {
    names.map(String::from).into()
}

/// A folder with demo.xml and its picture.
fn demo() -> TempDir {
    let at = tempdir().unwrap();
    for name in ["demo.xml", "globe.ppm"] {
        std::fs::copy(scene(name), at.path().join(name)).unwrap();
    }
    at
}

fn in_folder(at: &TempDir, command: &str) -> Ended {
    run(at.path(), command.split_whitespace())
}

#[test]
fn no_input_is_overwritten_and_no_output_twice() {
    let at = demo();
    std::fs::hard_link(at.path().join("globe.ppm"), at.path().join("other-name.ppm")).unwrap();
    std::fs::create_dir(at.path().join("sub")).unwrap();
    let small = "--size 8x6 --samples 1";
    assert_eq!(in_folder(&at, &format!("render demo.xml -o a.png {small}")).code, Some(0));
    assert_eq!(in_folder(&at, &format!("render demo.xml -o b.png {small} --max-depth 1")).code, Some(0));
    std::fs::copy(at.path().join("globe.ppm"), at.path().join("x.partial.ppm")).unwrap();
    let text = std::fs::read_to_string(at.path().join("demo.xml")).unwrap();
    std::fs::write(at.path().join("partial.xml"), text.replace("globe.ppm", "x.partial.ppm")).unwrap();
    let content = || -> Vec<Vec<u8>> {
        let files = ["demo.xml", "globe.ppm", "a.png", "b.png", "x.partial.ppm", "token", "k.pem"];
        files.map(|name| std::fs::read(at.path().join(name)).unwrap()).into()
    };
    std::fs::write(at.path().join("token"), "a secret").unwrap();
    std::fs::write(at.path().join("k.pem"), "a key").unwrap();
    let before = (content(), names(at.path()));
    for (command, words) in [
        ("render demo.xml -o globe.ppm", &["'globe.ppm' is a picture of the scene", "choose another name"][..]),
        ("render demo.xml -o other-name.ppm", &["is a picture of the scene"]),
        ("render demo.xml -o sub/../globe.ppm", &["is a picture of the scene"]),
        ("render demo.xml -o c.png --report globe.ppm", &["is a picture of the scene", "the report"]),
        ("render demo.xml -o c.png --report demo.xml", &["'demo.xml' is the scene", "the report"]),
        ("render demo.xml -o c.png --report sub/../c.png", &["both the picture and the report"]),
        ("render demo.xml -o c.png --report c.png.journal", &["both the report and the journal"]),
        ("render demo.xml -o c.png --journal demo.xml", &["'demo.xml' is the scene", "the journal"]),
        ("render demo.xml -o c.png --journal c.png", &["both the picture and the journal"]),
        ("render demo.xml -o c.png --journal globe.ppm", &["'globe.ppm'", "journal"]),
        ("render demo.xml -o c.png --token-file token --report token", &["'token' is the token", "the report"]),
        ("render demo.xml -o c.png --tls-cert k.pem --tls-key k.pem --journal k.pem", &["'k.pem' is the certificate"]),
        ("render partial.xml -o x.ppm", &["'x.partial.ppm' is a picture of the scene", "interruption"]),
        ("compare a.png b.png --diff a.png", &["'a.png' is a picture to compare"]),
        ("compare a.png b.png --diff sub/../b.png", &["is a picture to compare"]),
        ("measure demo.xml -o a --reference a.png", &["'a.png' is the reference"]),
        ("measure demo.xml --reference a.png -o a.png", &["'a.png' is the reference"]),
    ] {
        let flags = if command.starts_with("render") { small } else { "" };
        let ended = in_folder(&at, &format!("{command} {flags}"));
        assert_eq!(ended.code, Some(2), "{command}: {}", ended.err);
        for word in words {
            assert!(ended.err.contains(word), "{command}: '{word}' is not in: {}", ended.err);
        }
        assert!((content(), names(at.path())) == before, "{command} changed a file");
    }
}

#[test]
fn leftovers_of_killed_renders_go_with_the_next_one_and_those_of_others_stay() {
    let at = demo();
    let others = [".a.png.notes.tmp", ".b.png.12-3.tmp", ".a.png.1-x.tmp", "a.png.1-2.tmp"];
    for name in others.iter().chain(&[".a.png.999999999-0.tmp", ".a.png.1-17.tmp"]) {
        std::fs::write(at.path().join(name), "left").unwrap();
    }
    let ended = in_folder(&at, "render demo.xml -o a.png --size 8x6 --samples 1");
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let mut left = set(["a.png", "demo.xml", "globe.ppm"]);
    left.extend(others.map(String::from));
    assert_eq!(names(at.path()), left);
}

#[cfg(target_os = "linux")]
mod linux {
    use std::process::Command;

    use super::*;

    /// A file system of so many bytes, or `None` where this user may mount none.
    struct Small(TempDir);

    impl Small {
        fn new(bytes: u64) -> Option<Self> {
            let at = tempdir().unwrap();
            let mounted = Command::new("mount")
                .args(["-t", "tmpfs", "-o", &format!("size={bytes}"), "tmpfs"])
                .arg(at.path())
                .output();
            if mounted.is_ok_and(|m| m.status.success()) {
                return Some(Self(at));
            }
            eprintln!("skipped: nothing can be mounted here");
            None
        }

        fn remount(&self, how: &str) {
            let done = Command::new("mount").args(["-o", &format!("remount,{how}")]).arg(self.0.path()).status();
            assert!(done.unwrap().success());
        }
    }

    impl Drop for Small {
        fn drop(&mut self) {
            // Twice: a read-only view may lie over it.
            for _ in 0..2 {
                let _ = Command::new("umount").arg("-l").arg(self.0.path()).output();
            }
        }
    }

    /// Begins a render into `output` that takes some seconds, and waits until a part is done.
    fn begin(at: &Path, output: &Path, flags: &str) -> Running {
        let path = scene("demo.xml");
        let mut command = coordinator(at, ["render", path.to_str().unwrap(), "-o", output.to_str().unwrap()]);
        let mut running = Running::start(command.args(flags.split_whitespace()).args(["--progress", "json"]));
        assert!(running.line(|l| l.contains("\"progress\"")).is_some());
        running
    }

    const SECONDS: &str = "--size 400x300 --samples 100 --threads 2";

    #[test]
    fn room_is_asked_for_before_the_render() {
        let Some(small) = Small::new(1 << 20) else { return };
        let at = demo();
        for (size, name, fits) in [
            ("600x500", "a.ppm", true),
            ("600x600", "a.ppm", false),
            ("600x600", "a.png", false),
            ("8x6", "a.exr", true),
            ("2000x1000", "a.exr", false),
        ] {
            let output = small.0.path().join(name);
            let command = format!("render demo.xml -o {} --size {size} --samples 1", output.display());
            let ended = in_folder(&at, &command);
            if fits {
                assert_eq!(ended.code, Some(0), "{}", ended.err);
                std::fs::remove_file(output).unwrap();
            } else {
                assert_eq!(ended.code, Some(2), "{}", ended.err);
                assert!(ended.err.contains("will not fit on its disk"), "{}", ended.err);
            }
            assert_eq!(names(small.0.path()), set([]));
        }
    }

    #[test]
    fn a_disk_that_fills_up_meanwhile_costs_neither_picture_nor_render() {
        let Some(small) = Small::new(1 << 20) else { return };
        let at = tempdir().unwrap();
        let output = small.0.path().join("a.ppm");
        let running = begin(at.path(), &output, SECONDS);
        // All that is left: nothing for the journal.
        let filler = small.0.path().join("filler");
        let _ = std::fs::write(&filler, vec![1; 1 << 20]);
        let (status, said) = running.wait();
        assert_eq!(status.code(), Some(0), "{said}");
        assert_eq!(read(&output).unwrap().image.width(), 400);
        assert_eq!(names(small.0.path()), set(["a.ppm", "filler"]));
    }

    #[test]
    fn a_folder_that_goes_or_takes_nothing_any_more_costs_no_picture() {
        for how in ["gone", "read-only"] {
            let Some(small) = Small::new(64 << 20) else { return };
            let at = tempdir().unwrap();
            let folder = small.0.path().join("folder");
            std::fs::create_dir(&folder).unwrap();
            let output = folder.join("a.ppm");
            let running = begin(at.path(), &output, SECONDS);
            if how == "gone" {
                std::fs::remove_dir_all(&folder).unwrap();
            } else {
                // Files that are open for writing would stand in the way of an ordinary remount.
                let done = Command::new("mount").args(["-o", "remount,ro,bind"]).arg(small.0.path()).output().unwrap();
                if !done.status.success() {
                    let bound = Command::new("mount").arg("--bind").args([small.0.path(), small.0.path()]).status();
                    assert!(bound.unwrap().success());
                    small.remount("ro,bind");
                }
            }
            let (status, said) = running.wait();
            assert_eq!(status.code(), Some(1), "{how}: {said}");
            let place = at.path().join("a.ppm");
            assert!(said.contains(&format!("the picture is in '{}' instead", place.display())), "{how}: {said}");
            assert_eq!(read(&place).unwrap().image.width(), 400, "{how}");
        }
    }

    #[test]
    fn a_signal_while_the_picture_is_written_does_not_cost_it() {
        // A large one, so that there is time for signals; those that come too early or late tell nothing.
        let mut met = 0;
        for n in 0..8u64 {
            if met == 2 {
                break;
            }
            let at = tempdir().unwrap();
            let path = scene("demo.xml");
            let flags = "-o a.exr --size 4000x3000 --samples 1 --max-depth 1 --threads 2 --progress none -v";
            let mut command = coordinator(at.path(), ["render", path.to_str().unwrap()]);
            let mut running = Running::start(command.args(flags.split(' ')));
            if running.line(|l| l.contains("pass done")).is_none() {
                continue;
            }
            std::thread::sleep(std::time::Duration::from_millis(5 + 7 * n));
            running.signal("INT");
            std::thread::sleep(std::time::Duration::from_millis(10));
            let _ = Command::new("kill").arg("-INT").arg(running.id().to_string()).output();
            let (status, said) = running.wait();
            if said.contains("the picture is being written") {
                met += 1;
                assert_eq!(status.code(), Some(0), "{said}");
                assert_eq!(names(at.path()), set(["a.exr"]));
                assert_eq!(read(&at.path().join("a.exr")).unwrap().image.width(), 4000);
            }
        }
        assert!(met > 0, "no signal came while a picture was written");
    }
}
