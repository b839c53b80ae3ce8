//! `coordinator measure`: what accuracy costs on a scene, and which setting to take.

mod flags;
mod progress;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use coordinator::measure::{self, MeasureError, Measured, Order, PeerError, Plot, Reference, Stage};
use tessera_core::film::PixelsRef;
use tessera_core::film::file::{Depth, Output, OutputError, plan_text, write_text};
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_core::trace::PreparedScene;
use tokio::sync::watch;

use super::args::ProgressArg;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::files::Files;
use super::progress::{Style, done_json};
use super::render::{blocking, failure, on_runtime, unless_stopped};
use super::{scene, signals};
pub(super) use flags::{EXAMPLES, Flags, MORE};

/// Pixels of the PNG for each of the SVG.
const SCALE: u32 = 2;

/// Measures as the flags say; `began` is when the program started.
pub(super) fn run(raw: Flags, console: &Console, began: Instant) -> Result<Exit, Failure> {
    let options = Options::new(raw)?;
    on_runtime(options.threads, measure(options, console, began))
}

/// Flags that make sense, as far as can be known without reading the scene.
struct Options {
    raw: Flags,
    settings: Settings,
    workers: usize,
    threads: usize,
    files: Results,
    /// What is read and written.
    uses: Files,
    reference: Option<Reference>,
}

impl Options {
    fn new(raw: Flags) -> Result<Self, Failure> {
        let (width, height) = raw.size;
        let view = View::new(width, height, raw.zoom, raw.plane_height).map_err(Failure::usage)?;
        let settings = Settings {
            view,
            max_depth: raw.max_depth,
            sampling: Sampling::Uniform { grid: 1 },
            transfer: raw.transfer.into(),
        };
        let files = Results::plan(raw.output.as_deref(), &raw.scene)?;
        let mut uses = Files::default();
        uses.reads("the scene", &raw.scene)?;
        if let Some(path) = &raw.reference {
            uses.reads("the reference", path)?;
        }
        for path in [&*files.csv, &*files.json, &*files.svg, files.png.path()] {
            uses.writes("a result", path)?;
        }
        let reference = match &raw.reference {
            Some(path) => Some(Reference::read(path, raw.size, settings.transfer).map_err(Failure::usage)?),
            None => None,
        };
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self {
            workers: raw.workers.map_or(2, usize::from),
            threads: raw.threads.map_or_else(cores, usize::from),
            settings,
            files,
            uses,
            reference,
            raw,
        })
    }

    /// The command line of a render like those measured, without its accuracy and depth.
    fn render_command(&self) -> String {
        let raw = &self.raw;
        let mut words = vec!["coordinator render".to_owned(), quoted(&raw.scene)];
        let mut add = |flag: &str, value: String, default: &str| {
            if value != default {
                words.push(format!("{flag} {value}"));
            }
        };
        add("--size", format!("{}x{}", raw.size.0, raw.size.1), "640x480");
        add("--zoom", raw.zoom.to_string(), "1");
        add("--plane-height", raw.plane_height.to_string(), "1");
        add("--transfer", self.settings.transfer.name().into(), "srgb");
        add("--workers", self.workers.to_string(), "2");
        if let Some(threads) = raw.threads {
            add("--threads", threads.to_string(), "");
        }
        words.join(" ")
    }
}

/// A path as a shell takes it for one word.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+,:=@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

/// Where results go.
struct Results {
    csv: PathBuf,
    json: PathBuf,
    svg: PathBuf,
    png: Output,
}

impl Results {
    /// The files named `prefix`, in any case known to be writable.
    fn plan(prefix: Option<&Path>, scene: &Path) -> Result<Self, Failure> {
        let mut name = match prefix {
            Some(prefix) => {
                let known = prefix.extension().is_some_and(|e| ["csv", "json", "svg", "png"].iter().any(|k| e == *k));
                (if known { prefix.with_extension("") } else { prefix.into() }).into_os_string()
            }
            None => {
                let mut name = scene_name(scene)?.to_os_string();
                name.push("-curve");
                name
            }
        };
        name.push(".");
        let file = |extension: &str| {
            let mut name = name.clone();
            name.push(extension);
            PathBuf::from(name)
        };
        let text = |extension: &str| -> Result<PathBuf, OutputError> {
            let path = file(extension);
            plan_text(&path).map(|()| path)
        };
        let plan = || -> Result<Self, OutputError> {
            let png = Output::plan(&file("png"), Depth::Eight, Transfer::Srgb)?;
            Ok(Self { csv: text("csv")?, json: text("json")?, svg: text("svg")?, png })
        };
        plan().map_err(Failure::usage)
    }

    /// Writes everything; the plot only where there is something to plot.
    fn write(&self, measured: &Measured, render: &str) -> Result<(), Failure> {
        let failed = |e: &dyn std::fmt::Display| Failure::new(Exit::Failed, e);
        write_text(&self.csv, &measured.to_csv()).map_err(|e| failed(&e))?;
        let json = measured.to_json(render).map_err(|e| failed(&e))?;
        write_text(&self.json, &json).map_err(|e| failed(&e))?;
        let Some(plot) = Plot::new(measured) else { return Ok(()) };
        write_text(&self.svg, &plot.to_svg()).map_err(|e| failed(&e))?;
        let drawn = plot.to_pixels(SCALE);
        let (width, height, pixels) = drawn.ok_or_else(|| failed(&"there is no memory for the plot"))?;
        self.png.write(width, height, PixelsRef::Rgb8(&pixels)).map_err(|e| failed(&e))
    }

    fn told(&self, measured: &Measured) -> String {
        let mut names = vec![self.csv.as_path(), &self.json];
        if !measured.points.is_empty() {
            names.extend([self.svg.as_path(), self.png.path()]);
        }
        let names: Vec<String> = names.iter().map(|n| n.display().to_string()).collect();
        format!("written: {}", names.join(", "))
    }
}

/// The scene file's name without its extension.
fn scene_name(scene: &Path) -> Result<&std::ffi::OsStr, Failure> {
    scene.file_stem().ok_or_else(|| {
        Failure::usage(format!("'{}' names no scene file; give one, such as scene.xml", scene.display()))
    })
}

async fn measure(mut options: Options, console: &Console, began: Instant) -> Result<Exit, Failure> {
    let stop = signals::stop_on_signal(console);
    if options.raw.peers {
        // Said now rather than after minutes of our own renders.
        measure::povray_installed().await.map_err(|e: PeerError| Failure::new(Exit::Failed, e))?;
    }
    let reading = Instant::now();
    let (path, folders) = (options.raw.scene.clone(), options.raw.pictures.allow_pictures.clone());
    let read = unless_stopped(&stop, blocking(move || scene::read(&path, folders))).await??;
    let reading = reading.elapsed();
    for path in &read.pictures {
        options.uses.reads("a picture of the scene", path)?;
    }
    let scene = scene::accept(read, &options.raw.scene, console)?;
    let building = Instant::now();
    let prepared = unless_stopped(&stop, blocking(move || PreparedScene::build(scene))).await??;
    let order = Order {
        name: scene_name(&options.raw.scene)?.to_string_lossy().into_owned(),
        scene: Arc::new(prepared),
        settings: options.settings,
        workers: options.workers,
        threads: options.threads,
        read: reading,
        build: building.elapsed(),
        reference: options.reference.take(),
        reference_samples: options.raw.reference_samples,
        target: options.raw.target,
        peers: options.raw.peers,
        // What has passed by now belongs to it.
        budget: options.raw.budget.0.map(|budget| budget.saturating_sub(began.elapsed())),
        repeat: options.raw.repeat,
    };
    let (tell, watched) = watch::channel(Stage::start());
    let style = Style::of(options.raw.progress);
    let shown = tokio::spawn(progress::show(style, watched, console.clone()));
    let ended = measure::measure(order, tell, stop).await;
    // It ends by itself, its sender being gone; the bar must be off the screen before the next line.
    let _ = shown.await;
    let measured = ended.map_err(|e| match e {
        MeasureError::Render(e) => failure(&e),
        MeasureError::Files(_) => Failure::new(Exit::Failed, e),
    })?;

    let render = options.render_command();
    let text = measured.to_text(&render);
    let progress = options.raw.progress;
    let (told, unmeasured, interrupted) =
        (options.files.told(&measured), measured.points.is_empty(), measured.interrupted);
    let csv = options.files.csv.clone();
    blocking(move || options.files.write(&measured, &render)).await??;
    console.out(&text)?;
    match progress {
        ProgressArg::None => {}
        ProgressArg::Json => console.say(&done_json(&csv, began.elapsed())),
        _ => console.say(&told),
    }
    if interrupted {
        Err(Failure::new(Exit::Interrupted, "interrupted"))
    } else if unmeasured {
        Err(Failure::new(
            Exit::Failed,
            "there was no time to measure anything: give a larger --budget, or a smaller --size",
        ))
    } else {
        Ok(Exit::Done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_words_for_a_shell() {
        let word = |text: &str| quoted(Path::new(text));
        assert_eq!(word("scenes/demo.xml"), "scenes/demo.xml");
        assert_eq!(word("my scene.xml"), "'my scene.xml'");
        assert_eq!(word("it's.xml"), r"'it'\''s.xml'");
    }
}
