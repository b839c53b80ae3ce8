//! A farm that stays, as real processes: jobs come and go, it is killed and started again, and what it said holds.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;
use tessera_tests::loopback;
use tessera_tests::process::Process;
use tessera_tests::program::{self, Ended, run, scene};
use tessera_tests::wait::until;
use tessera_tests::web::{OWN_REQUEST, http};

/// A farm of its own in a folder of its own, with workers that outlast it.
struct Farm {
    folder: tempfile::TempDir,
    at: String,
    serve: Option<Process>,
    workers: Vec<Process>,
}

impl Farm {
    fn start(workers: usize) -> Self {
        let at = loopback::free().to_string();
        let mut farm = Self { folder: tempfile::tempdir().unwrap(), at, serve: None, workers: Vec::new() };
        farm.serve();
        farm.workers = (0..workers).map(|n| farm.worker(&format!("w{n}"))).collect();
        farm
    }

    fn serve(&mut self) {
        self.serve_at("none");
    }

    /// Starts it, with the page there.
    fn serve_at(&mut self, http: &str) {
        let state = self.folder.path().join("state");
        let args = ["serve", "--state", state.to_str().unwrap(), "--listen", &self.at, "--http", http];
        let mut serve = Process::start("coordinator", &args);
        serve.says(if http == "none" { "submit jobs by" } else { "the page is at" });
        self.serve = Some(serve);
    }

    fn worker(&self, name: &str) -> Process {
        Process::start("worker", &["--connect", &self.at, "--threads", "1", "--name", name])
    }

    fn kill(&mut self) {
        let serve = self.serve.take().unwrap();
        serve.signal(Signal::KILL);
        drop(serve);
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn call(&self, args: &[&str]) -> Ended {
        run(self.folder.path(), args.iter().chain(&["--farm", &self.at]))
    }

    fn ok(&self, args: &[&str]) -> String {
        let ended = self.call(args);
        assert_eq!(ended.code, Some(0), "{args:?}: {}", ended.err);
        ended.out
    }

    fn submit(&self, scene: &Path, more: &[&str]) -> u64 {
        self.ok(&[&["submit", scene.to_str().unwrap()], more].concat()).trim().parse().unwrap()
    }

    fn jobs(&self) -> BTreeMap<u64, Value> {
        let jobs: Vec<Value> = serde_json::from_str(&self.ok(&["jobs", "--json"])).unwrap();
        jobs.into_iter().map(|job| (job["id"].as_u64().unwrap(), job)).collect()
    }

    fn state(&self, id: u64) -> String {
        self.jobs()[&id]["state"].as_str().unwrap().to_owned()
    }

    fn until(&self, id: u64, state: &str) {
        until(&format!("job {id} is {state}"), || self.state(id) == state);
    }

    /// The bytes of a job's picture as floats.
    fn fetched(&self, id: u64) -> Vec<u8> {
        let path = self.path("fetched.pfm");
        self.ok(&["fetch", &id.to_string(), "-o", path.to_str().unwrap()]);
        fs::read(path).unwrap()
    }

    /// The same picture rendered by one process alone.
    fn alone(&self, scene: &Path, more: &[&str]) -> Vec<u8> {
        let path = self.path("alone.pfm");
        let args = ["render", scene.to_str().unwrap(), "-o", path.to_str().unwrap(), "--progress", "none"];
        let ended = run(self.folder.path(), args.iter().chain(more));
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        fs::read(path).unwrap()
    }
}

#[test]
fn jobs_are_rendered_one_after_another_by_the_same_workers_and_have_the_pixels_of_a_render() {
    let farm = Farm::start(2);
    let (demo, every) = (scene("demo.xml"), scene("every_element.xml"));
    let flags: &[&str] = &["--size", "96x64", "--max-error", "1"];
    let first = farm.submit(&demo, &[flags, &["--wait", "--owner", "ann"]].concat());
    let second = farm.submit(&every, &[flags, &["--wait", "--owner", "bob"]].concat());
    assert_eq!(farm.fetched(first), farm.alone(&demo, flags));
    assert_eq!(farm.fetched(second), farm.alone(&every, flags));
    // The same again is answered from what is there; another size is not.
    let again = farm.submit(&demo, &[flags, &["--owner", "bob", "--name", "again"]].concat());
    assert_eq!(farm.state(again), "done");
    assert_eq!(farm.jobs()[&again]["same_as"], first);
    let other = farm.submit(&demo, &["--size", "97x64", "--max-error", "1"]);
    assert_ne!(farm.state(other), "done");
    farm.until(other, "done");
    let workers: Vec<Value> = serde_json::from_str(&farm.ok(&["workers", "--json"])).unwrap();
    assert_eq!(workers.len(), 2);
    assert!(workers.iter().map(|w| w["tiles"].as_u64().unwrap()).sum::<u64>() > 0);
}

#[test]
fn a_render_by_a_farm_writes_the_same_file_as_one_that_is_local() {
    let farm = Farm::start(1);
    let demo = scene("demo.xml");
    let (here, there) = (farm.path("here.png"), farm.path("there.png"));
    let report = farm.path("report.json");
    let flags = ["--size", "80x60", "--max-error", "2", "--progress", "none"];
    let there_args = ["render", demo.to_str().unwrap(), "-o", there.to_str().unwrap()];
    let with_report = ["--report", report.to_str().unwrap()];
    farm.ok(&[&there_args[..], &flags, &with_report].concat());
    let here_args = ["render", demo.to_str().unwrap(), "-o", here.to_str().unwrap()];
    assert_eq!(run(farm.folder.path(), [&here_args[..], &flags].concat()).code, Some(0));
    assert_eq!(fs::read(here).unwrap(), fs::read(there).unwrap());
    let report = program::report(&report);
    assert_eq!((report["complete"].as_bool(), report["accuracy"]["target_met"].as_bool()), (Some(true), Some(true)));
    // A scene that is not valid is told here, as ever.
    let bad = farm.path("bad.xml");
    fs::write(&bad, "<scene/>").unwrap();
    assert_eq!(farm.call(&["render", bad.to_str().unwrap(), "-o", "bad.png"]).code, Some(3));
}

#[test]
fn jobs_are_paused_gone_on_with_and_cancelled() {
    let farm = Farm::start(1);
    let demo = scene("demo.xml");
    let long = farm.submit(&demo, &["--size", "1200x900", "--samples", "4096", "--owner", "ann"]);
    farm.until(long, "rendering");
    // A small one of somebody else does not wait for the giant.
    let small = farm.submit(&demo, &["--size", "64x48", "--samples", "1", "--owner", "bob", "--wait"]);
    assert_eq!((farm.state(small).as_str(), farm.state(long).as_str()), ("done", "rendering"));
    let id = long.to_string();
    farm.ok(&["pause", &id]);
    assert_eq!(farm.state(long), "paused");
    let wrong = farm.call(&["pause", &id]);
    assert_eq!(wrong.code, Some(2));
    assert!(wrong.err.contains("is paused"), "{}", wrong.err);
    farm.ok(&["resume", &id]);
    farm.until(long, "rendering");
    // As far as it is, it can be seen.
    until("something done", || farm.call(&["fetch", &id, "-o", "part.png", "--partial"]).code == Some(0));
    assert_ne!(farm.call(&["fetch", &id, "-o", "whole.png"]).code, Some(0));
    farm.ok(&["cancel", &id]);
    assert_eq!(farm.state(long), "cancelled");
    assert_eq!(farm.call(&["resume", &id]).code, Some(2));
    let unknown = farm.call(&["cancel", "999"]);
    assert!(unknown.code == Some(2) && unknown.err.contains("no job 999"), "{}", unknown.err);
    let journals = || fs::read_dir(farm.path("state").join("journals")).unwrap().count();
    until("no journal", || journals() == 0);
}

#[test]
fn a_job_is_given_up_at_its_deadline_and_goes_on_where_it_was_if_it_is_resumed() {
    let mut farm = Farm::start(1);
    let demo = scene("demo.xml");
    let long = ["--size", "1200x900", "--samples", "4096", "--owner", "ann"];
    let late = farm.submit(&demo, &[&long[..], &["--deadline", "1s"]].concat());
    farm.until(late, "failed");
    assert!(farm.jobs()[&late]["failure"].as_str().unwrap().contains("deadline"));
    farm.ok(&["resume", &late.to_string()]);
    farm.until(late, "rendering");
    assert_eq!(farm.jobs()[&late]["deadline_ms"], Value::Null);
    farm.ok(&["cancel", &late.to_string()]);
    // It passes also while the farm is away; who is done in time is not touched.
    let quick = farm.submit(&demo, &["--size", "32x24", "--samples", "1", "--wait", "--deadline", "1h"]);
    let lost = farm.submit(&demo, &[&long[..], &["--deadline", "1s"]].concat());
    farm.kill();
    farm.serve();
    farm.until(lost, "failed");
    assert_eq!(farm.state(quick), "done");
}

/// Instants of the kills.
const KILLS: usize = 100;

/// Every job is there, at least in the state that was told of it; of one that was asked to change as the farm was
/// killed, whatever is there counts from now on.
fn assert_kept(told: &mut BTreeMap<u64, &'static str>, jobs: &BTreeMap<u64, Value>, round: usize) {
    for (id, state) in told {
        let now = jobs.get(id).unwrap_or_else(|| panic!("round {round}: job {id} is gone"));
        let now = now["state"].as_str().unwrap();
        match *state {
            "queued" => assert!(["queued", "rendering", "done"].contains(&now), "round {round}: {id} is {now}"),
            "asked" => {
                let all = ["queued", "rendering", "done", "paused", "cancelled"];
                *state = all.into_iter().find(|s| *s == now).unwrap_or_else(|| panic!("round {round}: {id} is {now}"));
                if *state == "rendering" {
                    *state = "queued";
                }
            }
            sure => assert_eq!(now, sure, "round {round}: job {id}"),
        }
        if now == "done" {
            *state = "done";
        }
    }
}

#[test]
fn killed_at_any_instant_it_keeps_every_word_and_every_picture() {
    let mut farm = Farm::start(2);
    let (demo, every) = (scene("demo.xml"), scene("every_element.xml"));
    let mut seed = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = |below: u64| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) % below
    };
    // What was told: a job is at least in this state.
    let mut told = BTreeMap::new();
    let mut sizes = BTreeMap::<u64, (PathBuf, String)>::new();
    // Calls that the kill cut off: their answers never came.
    let mut cut_off = 0;
    for round in 0..KILLS {
        let after = Duration::from_millis(random(400));
        let is_killed = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let (farm, is_killed) = (&farm, &is_killed);
            scope.spawn(move || {
                std::thread::sleep(after);
                is_killed.store(true, Ordering::SeqCst);
                farm.serve.as_ref().unwrap().signal(Signal::KILL);
            });
            // Until a call is not answered.
            let mut answered = |args: &[&str]| {
                let ended = farm.call(args);
                if ended.code != Some(0) {
                    assert!(is_killed.load(Ordering::SeqCst), "{args:?}: {}", ended.err);
                    cut_off += 1;
                }
                (ended.code == Some(0)).then_some(ended.out)
            };
            loop {
                let size = format!("{}x{}", 40 + random(200), 30 + random(100));
                let scene = if random(2) == 0 { &demo } else { &every };
                let owner = format!("owner {}", random(3));
                let submit = ["submit", scene.to_str().unwrap(), "--size", &size, "--samples", "9", "--owner", &owner];
                let Some(id) = answered(&submit) else { break };
                let id: u64 = id.trim().parse().unwrap();
                assert!(!told.contains_key(&id), "the number {id} was used before");
                told.insert(id, "queued");
                sizes.insert(id, (scene.clone(), size.clone()));
                let (change, state) = [("pause", "paused"), ("cancel", "cancelled")][random(5) as usize / 3];
                if random(3) > 0 {
                    continue;
                }
                // One that is done already is neither.
                let ended = farm.call(&[change, &id.to_string()]);
                match ended.code {
                    Some(0) => drop(told.insert(id, state)),
                    _ if is_killed.load(Ordering::SeqCst) => {
                        // What it came to was never told.
                        told.insert(id, "asked");
                        break;
                    }
                    _ => {}
                }
            }
        });
        farm.serve = None;
        farm.serve();
        assert_kept(&mut told, &farm.jobs(), round);
    }
    assert!(cut_off > 0, "no call was on its way when it was killed");
    for (id, state) in told {
        if state == "paused" {
            farm.ok(&["resume", &id.to_string()]);
        }
        if state == "cancelled" {
            continue;
        }
        farm.until(id, "done");
        let (scene, size) = &sizes[&id];
        if id % 3 == 0 {
            assert_eq!(farm.fetched(id), farm.alone(scene, &["--size", size, "--samples", "9"]), "job {id}");
        }
    }
}

#[test]
fn a_farm_that_is_told_to_stop_keeps_what_is_done_and_two_do_not_share_a_folder() {
    let mut farm = Farm::start(1);
    let job = farm.submit(&scene("demo.xml"), &["--size", "400x300", "--samples", "400"]);
    farm.until(job, "rendering");
    let state = farm.path("state");
    let second = run(
        farm.folder.path(),
        ["serve", "--state", state.to_str().unwrap(), "--listen", "127.0.0.1:0", "--http", "none"],
    );
    assert!(second.code == Some(1) && second.err.contains("another farm"), "{}", second.err);
    let serve = farm.serve.take().unwrap();
    serve.signal(Signal::TERM);
    let (status, said) = serve.end();
    assert_eq!(status.code(), Some(130), "{said}");
    farm.serve();
    farm.until(job, "done");
    let flags = ["--size", "400x300", "--samples", "400"];
    assert_eq!(farm.fetched(job), farm.alone(&scene("demo.xml"), &flags));
}

#[test]
fn users_and_workers_have_secrets_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = loopback::free().to_string();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (state, workers, users) = (file("state"), file("workers"), file("users"));
    let environment = |command: &mut Command| {
        command.env("XDG_STATE_HOME", folder.path()).env_remove("TESSERA_TOKEN");
    };
    let tokens = ["--token-file", &workers, "--user-token-file", &users, "--http", "none"];
    let args = [&["serve", "--state", &state, "--listen", &at][..], &tokens].concat();
    let mut command = program::coordinator(folder.path(), args);
    environment(&mut command);
    let mut serve = program::Running::start(&mut command);
    serve.line(|line| line.contains("submit jobs by")).unwrap();
    let call = |args: &[&str]| -> Ended {
        let mut command = program::coordinator(folder.path(), args.iter().chain(&["--farm", &at]));
        environment(&mut command);
        command.output().unwrap().into()
    };
    let demo = scene("demo.xml").display().to_string();
    let submit = ["submit", &demo, "--size", "32x24", "--samples", "1"];
    assert_eq!(call(&[&submit[..], &["--user-token", &users]].concat()).code, Some(0));
    for bad in [&[][..], &["--user-token", &workers]] {
        let refused = call(&[&submit[..], bad].concat());
        assert_eq!(refused.code, Some(1), "{}", refused.err);
    }
    // A user is no worker.
    let mut command = Command::new(program::program("worker"));
    environment(&mut command);
    let ended: Ended = command.args(["--connect", &at, "--token-file", &users]).output().unwrap().into();
    assert_eq!(ended.code, Some(1), "{}", ended.err);
}

/// Whether `value` is what the document calls `name`: all that must be there is, and nothing else.
fn is_a(document: &Value, name: &str, value: &Value) {
    let schema = &document["components"]["schemas"][name];
    let required: Vec<&str> = schema["required"].as_array().unwrap().iter().map(|k| k.as_str().unwrap()).collect();
    let keys: Vec<&str> = value.as_object().unwrap().keys().map(String::as_str).collect();
    for key in &required {
        assert!(keys.contains(key), "{name} lacks {key}");
    }
    for key in keys {
        assert!(required.contains(&key) && !schema["properties"][key].is_null(), "{name} has {key}");
    }
}

/// Every figure in the dashboard for Grafana is one that the farm gives, by that name.
fn the_dashboard_asks_for_what_is_told(metrics: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/grafana.json");
    let dashboard: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let mut asked = 0;
    for panel in dashboard["panels"].as_array().unwrap() {
        for target in panel["targets"].as_array().unwrap() {
            let text = target["expr"].as_str().unwrap();
            let words = text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
            for name in words.filter(|word| word.starts_with("tessera_")) {
                assert!(metrics.contains(&format!("# TYPE {name} ")), "{name} is not told");
                asked += 1;
            }
        }
    }
    assert!(asked > 5);
}

/// Asks for everything that there is, with sense and without.
fn every_answer_is_documented(web: &str, document: &Value, id: u64) {
    for (path, item) in document["paths"].as_object().unwrap() {
        for method in ["get", "post"].into_iter().filter(|m| item.get(m).is_some()) {
            let documented = item[method]["responses"].as_object().unwrap();
            for named in [id.to_string(), "999".into(), "x".into(), "-1".into(), "99999999999999999999".into()] {
                for query in [
                    "",
                    "?x=1&y=1",
                    "?x=-1&y=q&limit=q&after=q&since=q&job=q&width=q&region=1",
                    "?region=0,0,9,9&width=0",
                ] {
                    let asked = path.replace("{id}", &named).replace("{name}", &named) + query;
                    let answer = http(web, &method.to_uppercase(), &asked, OWN_REQUEST);
                    let status = answer.status.to_string();
                    assert!(documented.contains_key(&status), "{method} {asked}: {status} is not documented");
                }
            }
        }
    }
}

/// A pixel is that of the file: 48 x 32 floats, rows from the bottom.
fn pixels_are_those_of_the_file(web: &str, id: u64, file: &[u8]) {
    let pixels = &file[file.len() - 48 * 32 * 12..];
    for (x, y) in [(0, 0), (47, 31), (20, 17)] {
        let pixel = http(web, "GET", &format!("/api/v1/jobs/{id}/pixel?x={x}&y={y}"), "").json();
        let at = 12 * ((31 - y) * 48 + x);
        for c in 0..3 {
            let bytes: [u8; 4] = pixels[at + 4 * c..at + 4 * c + 4].try_into().unwrap();
            assert_eq!(pixel["linear"][c].as_f64().unwrap() as f32, f32::from_le_bytes(bytes), "{x},{y}");
        }
    }
}

#[test]
fn the_interface_for_machines_is_what_its_document_says_and_the_page_is_for_this_machine_alone() {
    let mut farm = Farm::start(1);
    farm.kill();
    let web = loopback::free().to_string();
    farm.serve_at(&web);
    let demo = scene("demo.xml");
    let id = farm.submit(&demo, &["--size", "48x32", "--samples", "4", "--wait"]);
    let get = |path: &str| http(&web, "GET", path, "");

    let document = get("/api/v1/openapi.json").json();
    every_answer_is_documented(&web, &document, id);
    let jobs = get("/api/v1/jobs").json();
    is_a(&document, "Job", &jobs["jobs"][0]);
    assert_eq!(jobs["counts"]["done"], 1);
    let workers = get("/api/v1/workers").json();
    is_a(&document, "Worker", &workers["workers"][0]);

    pixels_are_those_of_the_file(&web, id, &farm.fetched(id));
    let picture = get(&format!("/api/v1/jobs/{id}/picture.png?region=8,8,24,16&width=32"));
    assert_eq!(&picture.body[1..4], b"PNG");
    assert_eq!(&picture.body[16..24], [0, 0, 0, 32, 0, 0, 0, 16]);

    let page = get("/");
    assert!(page.head.contains("content-security-policy: default-src 'none'"), "{}", page.head);
    assert_eq!(http(&web, "GET", "/", "Host: evil.example\r\n").status, 421);
    let pause = format!("/api/v1/jobs/{id}/pause");
    assert_eq!(http(&web, "POST", &pause, "Origin: http://evil.example\r\n").status, 403);
    assert_eq!(http(&web, "POST", &pause, "").status, 403, "a form can send that");
    assert_eq!(http(&web, "POST", &pause, OWN_REQUEST).status, 409);
    assert!(String::from_utf8(get("/metrics").body).unwrap().contains("tessera_jobs{state=\"done\"} 1"));
    the_dashboard_asks_for_what_is_told(&String::from_utf8(get("/metrics").body).unwrap());
    let log = get("/api/v1/log").json()["lines"].to_string();
    assert!(log.contains("w0 ") && log.contains(&format!("job {id} 'demo' of ")) && log.contains(": done"), "{log}");
    let event = String::from_utf8(get(&format!("/api/v1/events?job={id}")).body).unwrap();
    assert!(event.contains("event: state") && event.contains("\"state\":\"done\""), "{event}");

    // Another picture grows while it is looked at.
    let long = farm.submit(&demo, &["--size", "1200x900", "--samples", "4096"]);
    until("a tile", || !get(&format!("/api/v1/jobs/{long}/tiles")).json()["tiles"].as_array().unwrap().is_empty());
    assert_eq!(get(&format!("/api/v1/jobs/{long}/picture.png?width=64")).status, 200);
    // It stays when the farm is killed, and can be seen before it is rendered again.
    farm.ok(&["pause", &long.to_string()]);
    farm.kill();
    farm.serve_at(&web);
    assert_eq!(get(&format!("/api/v1/jobs/{long}")).json()["state"], "paused");
    // Whoever is drained leaves for good.
    until("the worker back", || get("/api/v1/workers").json()["count"] == 1);
    assert_eq!(http(&web, "POST", "/api/v1/workers/w0/drain", OWN_REQUEST).status, 200);
    let (status, said) = farm.workers.remove(0).end();
    assert_eq!(status.code(), Some(0), "{said}");
}
