//! The page as a browser shows it: headless Chromium, driven over its own protocol.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::future::Future;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use chromiumoxide::cdp::browser_protocol::page::CaptureScreenshotFormat;
use chromiumoxide::layout::Point;
use chromiumoxide::page::ScreenshotParams;
use chromiumoxide::{Browser, BrowserConfig, Page};
use rustix::process::Signal;
use serde_json::Value;
use tessera_tests::judge::judge;
use tessera_tests::loopback;
use tessera_tests::process::Process;
use tessera_tests::program::{Running, coordinator, run, scene};
use tokio::time::timeout;
use tokio_stream::StreamExt;

/// Longer than anything here takes.
const NEVER: Duration = Duration::from_secs(120);
/// How long one question to the browser may take: it may be lost where a page is just being loaded.
const SOON: Duration = Duration::from_secs(20);

/// Chromium, where it is.
fn chromium() -> Option<PathBuf> {
    judge("chromium", &["--version"]).then(|| "/usr/bin/chromium".into())
}

/// A browser with one page open.
struct Watcher {
    _browser: Browser,
    _profile: tempfile::TempDir,
    page: Page,
}

impl Watcher {
    async fn open(program: &Path, url: &str) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let config = BrowserConfig::builder()
            .chrome_executable(program)
            .user_data_dir(profile.path())
            .no_sandbox()
            .launch_timeout(NEVER)
            .request_timeout(NEVER)
            .window_size(1280, 1000)
            .viewport(None)
            .args(["--disable-gpu", "--disable-dev-shm-usage", "--disable-background-networking"])
            .build()
            .unwrap();
        let (browser, mut handler) = Browser::launch(config).await.unwrap();
        // What it does not understand of a newer browser's words is of no use here.
        tokio::spawn(async move { while handler.next().await.is_some() {} });
        // It takes certificates that nobody knows only once there is a page.
        let page = browser.new_page("about:blank").await.unwrap();
        let watcher = Self { _browser: browser, _profile: profile, page };
        let start = Instant::now();
        while timeout(SOON, watcher.page.goto(url)).await.is_err() {
            assert!(start.elapsed() < NEVER, "{url} is never loaded");
        }
        watcher
    }

    /// What a script gives; null where it fails, as it does while another page is loaded.
    async fn eval(&self, script: &str) -> Value {
        match timeout(SOON, self.page.evaluate(format!("(() => {{ {script} }})()"))).await {
            Ok(Ok(result)) => result.value().cloned().unwrap_or(Value::Null),
            Ok(Err(_)) | Err(_) => Value::Null,
        }
    }

    /// Waits until a script gives true.
    async fn until(&self, what: &str, script: &str) {
        let start = Instant::now();
        while self.eval(script).await != Value::Bool(true) {
            if start.elapsed() > NEVER {
                self.shot("failed").await;
                let text = self.eval("return document.body.innerText").await;
                panic!("never {what}; the page says: {text}");
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    async fn click(&self, selector: &str) {
        let script = format!("const e = document.querySelector('{selector}'); e?.click(); return e != null");
        self.until(&format!("a '{selector}' to click"), &script).await;
    }

    /// Keeps what is seen, where SCREENSHOTS names a folder.
    async fn shot(&self, name: &str) {
        let Some(folder) = std::env::var_os("SCREENSHOTS") else { return };
        let params = ScreenshotParams::builder().format(CaptureScreenshotFormat::Png).full_page(true).build();
        let _ = self.page.save_screenshot(params, Path::new(&folder).join(format!("{name}.png"))).await;
    }

    /// Pixels of the picture's canvas that show something.
    async fn lit(&self) -> u64 {
        self.eval(LIT).await.as_u64().unwrap_or(0)
    }
}

const LIT: &str =
    "const c = document.getElementById('picture'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
    let n = 0; for (let i = 0; i < d.length; i += 4) if (d[i] + d[i + 1] + d[i + 2] > 24) n++; return n";

/// Pixels of the overlay that are painted.
const TINTED: &str =
    "const c = document.getElementById('tint'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
    let n = 0; for (let i = 3; i < d.length; i += 4) if (d[i] > 0) n++; return n";

/// Does not wait for threads that read what a browser says, however a test ends.
struct Runtime(Option<tokio::runtime::Runtime>);

impl Drop for Runtime {
    fn drop(&mut self) {
        self.0.take().unwrap().shutdown_background();
    }
}

fn on_runtime(work: impl Future<Output = ()>) {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
    let runtime = Runtime(Some(runtime.unwrap()));
    runtime.0.as_ref().unwrap().block_on(work);
}

/// A farm that can be killed and started again, and its worker, which outlasts it.
struct Farm {
    folder: tempfile::TempDir,
    at: String,
    web: String,
    serve: Option<Process>,
    _worker: Process,
}

impl Farm {
    fn start() -> Self {
        let (folder, at, web) =
            (tempfile::tempdir().unwrap(), loopback::free().to_string(), loopback::free().to_string());
        let serve = Some(Self::serve(folder.path(), &at, &web));
        let worker = Process::start("worker", &["--connect", &at, "--threads", "1", "--name", "bert"]);
        Self { folder, at, web, serve, _worker: worker }
    }

    fn serve(folder: &Path, at: &str, web: &str) -> Process {
        let state = folder.join("state").display().to_string();
        let mut serve = Process::start("coordinator", &["serve", "--state", &state, "--listen", at, "--http", web]);
        serve.says("the page is at");
        serve
    }

    fn kill(&mut self) {
        self.serve.take().unwrap().signal(Signal::KILL);
    }

    fn again(&mut self) {
        self.serve = Some(Self::serve(self.folder.path(), &self.at, &self.web));
    }

    fn submit(&self, size: &str, samples: &str) -> u64 {
        let demo = scene("demo.xml").display().to_string();
        let args = ["submit", &demo, "--size", size, "--samples", samples, "--farm", &self.at];
        let ended = run(self.folder.path(), args);
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        ended.out.trim().parse().unwrap()
    }
}

/// What the state of job `id` reads in the table.
fn reads(id: u64, state: &str) -> String {
    format!(
        "return [...document.querySelectorAll('#job-rows tr')].some(r => r.cells[0].textContent === '{id}' && r.cells[3].textContent === '{state}')"
    )
}

#[test]
fn a_picture_grows_and_its_job_is_paused_gone_on_with_and_cancelled() {
    let Some(program) = chromium() else { return };
    let mut farm = Farm::start();
    let id = farm.submit("1200x900", "4096");
    on_runtime(async move {
        let watcher = Watcher::open(&program, &format!("http://{}/", farm.web)).await;
        watcher
            .until(
                "the job is chosen",
                &format!("return document.getElementById('title').textContent.startsWith('{id} ')"),
            )
            .await;
        watcher.until("something is seen", &format!("return (() => {{ {LIT} }})() > 0")).await;
        let first = watcher.lit().await;
        watcher.until("the picture has grown", &format!("return (() => {{ {LIT} }})() > {first}")).await;
        assert_eq!(watcher.eval("return document.querySelector('#worker-rows td').textContent").await, "bert");

        for kind in ["worker", "cost", "pass", "error"] {
            let choose = format!(
                "const s = document.getElementById('overlay'); s.value = '{kind}'; s.dispatchEvent(new Event('change')); {TINTED}"
            );
            assert!(watcher.eval(&choose).await.as_u64().unwrap() > 0, "nothing is tinted by {kind}");
        }
        watcher.shot("growing").await;
        let none = "const s = document.getElementById('overlay'); s.value = ''; s.dispatchEvent(new Event('change'));";
        assert_eq!(watcher.eval(&format!("{none} {TINTED}")).await, 0);

        watcher.click(&format!("[aria-label=\"pause job {id}\"]")).await;
        watcher.until("it is paused", &reads(id, "paused")).await;
        // Killed and started again, the page finds it again by itself, as it was.
        farm.kill();
        watcher.until("the loss is told", "return !document.getElementById('lost').hidden").await;
        farm.again();
        watcher.until("it is connected again", "return document.getElementById('lost').hidden").await;
        watcher.until("it is paused still", &reads(id, "paused")).await;
        watcher.click(&format!("[aria-label=\"resume job {id}\"]")).await;
        watcher.until("it is rendered again", &reads(id, "rendering")).await;
        watcher.click(&format!("[aria-label=\"cancel job {id}\"]")).await;
        watcher.until("it is cancelled", &reads(id, "cancelled")).await;
        watcher.shot("cancelled").await;
    });
}

#[test]
fn the_pixel_under_the_pointer_is_that_of_the_file() {
    let Some(program) = chromium() else { return };
    let farm = Farm::start();
    let id = farm.submit("48x32", "9");
    let file = farm.folder.path().join("fetched.pfm");
    let wait = Instant::now();
    while run(farm.folder.path(), ["fetch", &id.to_string(), "-o", file.to_str().unwrap(), "--farm", &farm.at]).code
        != Some(0)
    {
        assert!(wait.elapsed() < NEVER, "the job is never done");
        std::thread::sleep(Duration::from_millis(50));
    }
    let file = std::fs::read(file).unwrap();
    let pixels = &file[file.len() - 48 * 32 * 12..];
    on_runtime(async move {
        let watcher = Watcher::open(&program, &format!("http://{}/", farm.web)).await;
        watcher.until("something is seen", &format!("return (() => {{ {LIT} }})() > 0")).await;
        for (x, y) in [(1, 1), (24, 16), (40, 28)] {
            // Where the pixel is: the picture fits the frame.
            let place = watcher
                .eval(&format!(
                    "const r = document.getElementById('picture').getBoundingClientRect(), s = Math.min(r.width / 48, r.height / 32);
                     return [r.left + (r.width - 48 * s) / 2 + ({x} + .5) * s, r.top + (r.height - 32 * s) / 2 + ({y} + .5) * s]"
                ))
                .await;
            let (left, top) = (place[0].as_f64().unwrap(), place[1].as_f64().unwrap());
            watcher.page.move_mouse(Point::new(left, top)).await.unwrap();
            let said = "document.getElementById('readout').textContent";
            watcher.until(&format!("{x}, {y} is read"), &format!("return {said}.startsWith('{x}, {y} ')")).await;
            let said = watcher.eval(&format!("return {said}")).await;
            let at = 12 * ((31 - y) * 48 + x);
            let linear: Vec<String> = (0..3)
                .map(|c| f32::from_le_bytes(pixels[at + 4 * c..at + 4 * c + 4].try_into().unwrap()))
                .map(|value| format!("{value:.5}"))
                .collect();
            assert!(said.as_str().unwrap().contains(&format!("linear {}", linear.join(" "))), "{said} and {linear:?}");
        }
        watcher.shot("readout").await;
    });
}

#[test]
fn a_browser_logs_in_by_the_users_token_and_out() {
    let Some(program) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let port = loopback::free().port();
    let http = format!("0.0.0.0:{port}");
    let mut command =
        coordinator(folder.path(), ["serve", "--state", "farm", "--listen", "127.0.0.1:0", "--http", &http]);
    command.env("XDG_STATE_HOME", folder.path()).env_remove("TESSERA_TOKEN");
    let mut serve = Running::start(&mut command);
    serve.line(|line| line.contains("the page is at")).unwrap();
    let token = std::fs::read_to_string(folder.path().join("tessera/user-token")).unwrap();
    on_runtime(async move {
        let watcher = Watcher::open(&program, &format!("https://localhost:{port}/")).await;
        let log_in = |token: &str| {
            format!(
                "document.getElementById('token').value = '{}'; document.querySelector('#login button').click()",
                token.trim()
            )
        };
        watcher.until("it asks for a token", "return document.getElementById('login') != null").await;
        watcher.shot("login").await;
        watcher.eval(&log_in("nonsense")).await;
        watcher
            .until("it is refused", "return document.getElementById('said').textContent.includes('not the users')")
            .await;
        watcher.eval(&log_in(&token)).await;
        watcher
            .until(
                "the farm is seen",
                "return document.getElementById('summary')?.textContent.includes('0 workers') ?? false",
            )
            .await;
        assert_eq!(watcher.eval("return document.cookie").await, "", "scripts see the cookie");
        watcher.click("#logout").await;
        watcher.until("it asks again", "return document.getElementById('login') != null").await;
        assert_eq!(watcher.eval("return document.getElementById('jobs')").await, Value::Null);
    });
}

#[test]
fn a_single_render_is_watched_and_given_up() {
    let Some(program) = chromium() else { return };
    let (folder, web) = (tempfile::tempdir().unwrap(), loopback::free().to_string());
    let demo = scene("demo.xml").display().to_string();
    let args = ["render", &demo, "-o", "demo.png", "--size", "1200x900", "--samples", "4096", "--http", &web];
    let mut render = Running::start(&mut coordinator(folder.path(), args));
    render.line(|line| line.contains("the page is at")).unwrap();
    on_runtime(async move {
        let watcher = Watcher::open(&program, &format!("http://{web}/")).await;
        watcher.until("something is seen", &format!("return (() => {{ {LIT} }})() > 0")).await;
        let first = watcher.lit().await;
        watcher.until("the picture has grown", &format!("return (() => {{ {LIT} }})() > {first}")).await;
        watcher.until("its workers are seen", "return document.querySelectorAll('#worker-rows tr').length === 2").await;
        assert_eq!(watcher.eval("return document.querySelectorAll('[aria-label^=pause]').length").await, 0);
        watcher.shot("single").await;
        watcher.click("[aria-label=\"cancel job 1\"]").await;
    });
    let (status, said) = render.wait();
    assert_eq!(status.code(), Some(130), "{said}");
}

/// `SCREENSHOTS=docs/images cargo test --release -p tessera-tests --test page -- --ignored` takes the documents' picture.
#[test]
#[ignore = "it writes a picture for the documents"]
fn what_the_documents_show() {
    let Some(program) = chromium() else { return };
    let (folder, web) = (tempfile::tempdir().unwrap(), loopback::free().to_string());
    let mirrors = scene("mirrors.xml").display().to_string();
    let view = ["--size", "960x720", "--max-depth", "8", "--max-error", "0.25", "--verify", "1/10", "--workers", "4"];
    let mut command =
        coordinator(folder.path(), ["render", &mirrors, "-o", "mirrors.png", "--http", &web].iter().chain(&view));
    let mut render = Running::start(&mut command);
    render.line(|line| line.contains("the page is at")).unwrap();
    on_runtime(async move {
        let watcher = Watcher::open(&program, &format!("http://{web}/")).await;
        let half = "return +(document.getElementById('progress').getAttribute('aria-valuenow')) >= 60";
        watcher.until("more than half is seen", half).await;
        watcher.shot("page").await;
        watcher.click("[aria-label=\"cancel job 1\"]").await;
    });
    let _ = render.wait();
}
