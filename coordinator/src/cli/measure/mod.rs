//! `coordinator measure`: what accuracy costs on a scene, and which setting to take.

mod progress;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::CommandFactory;
use coordinator::measure::{self, MeasureError, Measured, Method, Order, PeerError, Plot, Point, Reference, Stage};
use tessera_core::film::PixelsRef;
use tessera_core::film::file::{Depth, Output, OutputError, plan_text, write_text};
use tessera_core::settings::{Quality, Sampling, Settings, Transfer, View};
use tessera_core::trace::PreparedScene;
use tokio::sync::watch;

use super::args::{Args, Measure, ProgressArg};
use super::console::Console;
use super::exit::{Exit, Failure};
use super::files::Files;
use super::options::WORKERS;
use super::progress::{Style, done_json};
use super::runtime::{blocking, on_runtime, unless_stopped};
use super::{scene, signals};

/// Pixels of the PNG for each of the SVG.
const SCALE: u32 = 2;

/// Measures as the flags say; `began` is when the program started.
pub(super) fn run(raw: Measure, console: &Console, began: Instant) -> Result<Exit, Failure> {
    let options = Options::new(raw)?;
    on_runtime(options.threads, measure(options, console, began))
}

/// Flags that make sense, as far as can be known without reading the scene.
struct Options {
    raw: Measure,
    settings: Settings,
    workers: usize,
    threads: usize,
    files: Results,
    /// What is read and written.
    uses: Files,
    reference: Option<Reference>,
}

impl Options {
    fn new(raw: Measure) -> Result<Self, Failure> {
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
            workers: raw.workers.map_or(WORKERS, usize::from),
            threads: raw.threads.map_or_else(cores, usize::from),
            settings,
            files,
            uses,
            reference,
            raw,
        })
    }

    /// The command line that renders a point again: what of the picture is not as by default, and the point's flags.
    fn render_command(&self, method: Method, point_flags: &[String]) -> String {
        let (raw, args) = (&self.raw, Args::command());
        let flags = args.find_subcommand("render");
        let default = |long: &str| {
            let flag = flags?.get_arguments().find(|arg| arg.get_long() == Some(long))?;
            Some(flag.get_default_values().first()?.to_string_lossy().into_owned())
        };
        let mut words = vec!["coordinator render".to_owned(), quoted(&raw.scene)];
        let mut add = |long: &str, value: String| {
            if default(long).as_ref() != Some(&value) {
                words.push(format!("--{long} {value}"));
            }
        };
        add("size", format!("{}x{}", raw.size.0, raw.size.1));
        add("zoom", raw.zoom.to_string());
        add("plane-height", raw.plane_height.to_string());
        add("transfer", self.settings.transfer.name().into());
        if self.workers != WORKERS {
            add("workers", self.workers.to_string());
        }
        if let Some(threads) = raw.threads {
            add("threads", threads.to_string());
        }
        if method != Method::MaxDepth {
            add("max-depth", raw.max_depth.to_string());
        }
        words.extend(point_flags.iter().cloned());
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
    fn write(&self, measured: &Measured, command: impl Fn(&Point) -> String) -> Result<(), Failure> {
        let failed = |e: &dyn std::fmt::Display| Failure::new(Exit::Failed, e);
        write_text(&self.csv, &measured.to_csv()).map_err(|e| failed(&e))?;
        let json = measured.to_json(command).map_err(|e| failed(&e))?;
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
        // Where nothing is said of accuracy, `render` takes it.
        quality: Quality::default(),
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
        MeasureError::Render(e) => Failure::from(&e),
        MeasureError::Files(_) => Failure::new(Exit::Failed, e),
    })?;

    let text = measured.to_text(|point| options.render_command(point.method, &point.flags));
    let progress = options.raw.progress;
    let (told, unmeasured, interrupted) =
        (options.files.told(&measured), measured.points.is_empty(), measured.interrupted);
    let csv = options.files.csv.clone();
    blocking(move || options.files.write(&measured, |point| options.render_command(point.method, &point.flags)))
        .await??;
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
    use clap::Parser;

    use super::*;
    use crate::cli::args::Command;

    #[test]
    fn commands_say_what_is_not_the_default_and_name_a_depth_once() {
        let folder = tempfile::tempdir().unwrap();
        let prefix = folder.path().join("curve").display().to_string();
        let options = |flags: &[&str]| {
            let words = ["coordinator", "measure", "a.xml", "-o", &prefix].into_iter().chain(flags.iter().copied());
            let Ok(Args { command: Command::Measure(raw), .. }) = Args::try_parse_from(words) else {
                panic!("no flags")
            };
            Options::new(*raw).unwrap()
        };
        let command = |options: &Options, method: Method, flags: [&str; 2]| {
            options.render_command(method, &flags.map(str::to_owned))
        };
        let plain = options(&[]);
        let said = command(&plain, Method::MaxError, ["--max-error", "0.5"]);
        assert_eq!(said, "coordinator render a.xml --max-error 0.5");
        let other = options(&["--max-depth", "8", "--size", "64x48", "--workers", "1"]);
        let said = command(&other, Method::MaxDepth, ["--max-depth", "4"]);
        assert_eq!(said, "coordinator render a.xml --size 64x48 --workers 1 --max-depth 4");
        let said = command(&other, Method::Samples, ["--samples", "4"]);
        assert_eq!(said, "coordinator render a.xml --size 64x48 --workers 1 --max-depth 8 --samples 4");
    }

    #[test]
    fn paths_are_words_for_a_shell() {
        let word = |text: &str| quoted(Path::new(text));
        assert_eq!(word("scenes/demo.xml"), "scenes/demo.xml");
        assert_eq!(word("my scene.xml"), "'my scene.xml'");
        assert_eq!(word("it's.xml"), r"'it'\''s.xml'");
    }
}
