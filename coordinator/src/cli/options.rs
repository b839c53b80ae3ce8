//! The flags of `render`, checked and made sense of.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use coordinator::fleet::Engine;
use coordinator::{Goal, ListenAddr, Patience, PixelFormat, TileSize};
use tessera_core::film::Region;
use tessera_core::film::file::{Depth, Output};
use tessera_core::settings::{Quality, Sampling, Settings, View};

use super::access::AccessFlags;
use super::args::{OwnFleet, PatternArg, ProgressArg, Render, TileArg, ViewFlags};
use super::exit::{Exit, Failure};

/// The port where a listener gives none.
const DEFAULT_PORT: u16 = 4747;

/// Workers in this process where none are awaited.
pub(crate) const WORKERS: usize = 2;

/// A render that makes sense, as far as can be known without reading the scene.
#[derive(Debug)]
pub(crate) struct Options {
    pub(crate) scene: PathBuf,
    pub(crate) output: Output,
    pub(crate) settings: Settings,
    pub(crate) accuracy: Accuracy,
    pub(crate) region: Region,
    pub(crate) pixels: PixelFormat,
    pub(crate) tile: TileSize,
    /// The farm that is to render it.
    pub(crate) farm: Option<worker::Address>,
    pub(crate) workers: usize,
    pub(crate) threads: usize,
    pub(crate) listen: Option<String>,
    /// Where the page is, or `none`.
    pub(crate) http: String,
    pub(crate) patience: Patience,
    pub(crate) access: AccessFlags,
    /// Workers that an engine starts.
    pub(crate) fleet: OwnFleet,
    /// Share of the tiles that are rendered twice, 0 to 1.
    pub(crate) verify: f64,
    /// Folders that pictures are taken from beside the scene's own.
    pub(crate) pictures: Vec<PathBuf>,
    pub(crate) report: Option<ReportTo>,
    /// Where what is done is kept.
    pub(crate) journal: Option<PathBuf>,
    /// Whether what an earlier run left is not wanted.
    pub(crate) restart: bool,
    pub(crate) progress: ProgressArg,
    /// What was asked for and will have no effect.
    pub(crate) notes: Vec<String>,
}

/// What was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Accuracy {
    /// So many points in every pixel.
    Samples,
    Quality(Quality),
    /// A fraction of full scale.
    Error(f64),
    /// From the program's start, and an error that is enough.
    Time {
        limit: Duration,
        error: Option<f64>,
    },
}

/// Where the report goes.
#[derive(Debug)]
pub(crate) enum ReportTo {
    Stdout,
    File(PathBuf),
}

impl Accuracy {
    /// The root mean squared error asked for, as a fraction of full scale.
    pub(crate) fn target(self) -> Option<f64> {
        match self {
            Self::Samples => None,
            Self::Quality(quality) => Some(quality.rmse()),
            Self::Error(error) => Some(error),
            Self::Time { error, .. } => error,
        }
    }

    /// What a farm is to aim at.
    pub(crate) fn goal(self) -> Goal {
        match self {
            Self::Samples => Goal::AsSet,
            Self::Quality(quality) => Goal::Error(quality.rmse()),
            Self::Error(error) => Goal::Error(error),
            Self::Time { limit, error } => Goal::Time { limit, error },
        }
    }
}

/// What is to be rendered, and how well.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted {
    pub(crate) settings: Settings,
    pub(crate) accuracy: Accuracy,
    pub(crate) region: Region,
}

impl Wanted {
    /// Checks flags against each other.
    pub(crate) fn new(flags: &ViewFlags) -> Result<Self, Failure> {
        let (width, height) = flags.size;
        let view = View::new(width, height, flags.zoom, flags.plane_height).map_err(Failure::usage)?;
        let quality = flags.quality.map(Quality::from);
        let accuracy = match (quality, flags.max_error, flags.time_limit) {
            (Some(quality), ..) => Accuracy::Quality(quality),
            (None, None, None) => flags.samples.map_or(Accuracy::Quality(Quality::default()), |_| Accuracy::Samples),
            (None, Some(steps), None) => Accuracy::Error(steps / 255.0),
            (None, steps, Some(limit)) => Accuracy::Time { limit, error: steps.map(|s| s / 255.0) },
        };
        let sampling = match (flags.samples, flags.pattern) {
            (None, _) => Sampling::Adaptive,
            (Some(samples), PatternArg::Grid) => Sampling::uniform(samples).map_err(Failure::usage)?,
            (Some(samples), PatternArg::Scrambled) => Sampling::scrambled(samples).map_err(Failure::usage)?,
        };
        let settings = Settings { view, max_depth: flags.max_depth, sampling, transfer: flags.transfer.into() };
        let whole = Region { x0: 0, y0: 0, x1: width, y1: height };
        let region = flags.region.unwrap_or(whole);
        if !whole.contains(&region) {
            let Region { x0, y0, x1, y1 } = region;
            return Err(Failure::usage(format!(
                "--region {x0},{y0},{x1},{y1} reaches outside the picture of {width}x{height} pixels"
            )));
        }
        Ok(Self { settings, accuracy, region })
    }
}

impl ViewFlags {
    /// The edge of a tile that was asked for.
    pub(crate) fn tile(&self) -> TileSize {
        match self.tile {
            TileArg::Auto => TileSize::Auto,
            TileArg::Edge(n) => TileSize::Edge(n),
        }
    }
}

impl Options {
    /// Checks everything that can be wrong before the scene is read: numbers against each
    /// other, the picture's place, the report's place.
    pub(crate) fn new(raw: Render) -> Result<Self, Failure> {
        let Wanted { settings, accuracy, region } = Wanted::new(&raw.view)?;
        let depth = if raw.bits == "16" { Depth::Sixteen } else { Depth::Eight };
        let path = match raw.output {
            Some(path) => path,
            None => default_output(&raw.scene)?,
        };
        let output = Output::plan(&path, depth, settings.transfer).map_err(Failure::usage)?;
        let mut notes = Vec::new();
        if output.kind().is_float() && depth == Depth::Sixteen {
            notes.push(format!("--bits has no effect: .{} files hold 32-bit floats", output.kind().extension()));
        }
        let report = match raw.report {
            None => None,
            Some(path) if path.as_os_str() == "-" => Some(ReportTo::Stdout),
            Some(path) => {
                tessera_core::film::file::plan_text(&path).map_err(Failure::usage)?;
                Some(ReportTo::File(path))
            }
        };
        // Floats are asked of workers only where something needs them: the hash in a report does.
        let pixels = match (output.depth(), &report) {
            (Some(Depth::Eight), None) => PixelFormat::Rgb8,
            (Some(Depth::Sixteen), None) => PixelFormat::Rgb16,
            _ => PixelFormat::F32,
        };
        raw.fleet.check(raw.listen.is_some())?;
        let journal = journal_place(raw.journal, &path);
        let workers = raw.workers.map_or(if raw.listen.is_some() { 0 } else { WORKERS }, usize::from);
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self {
            scene: raw.scene,
            output,
            settings,
            accuracy,
            region,
            pixels,
            tile: raw.view.tile(),
            farm: raw.farm,
            workers,
            threads: raw.threads.map_or_else(cores, usize::from),
            listen: raw.listen,
            http: raw.http,
            patience: match raw.wait_for_workers {
                Some(time) => time.into(),
                // An engine starts workers when it is their turn, and says itself what it does not take.
                None if raw.fleet.fleet.is_some() => Duration::MAX.into(),
                None => Patience::default(),
            },
            journal,
            restart: raw.restart,
            access: raw.access,
            fleet: raw.fleet,
            verify: raw.view.verify,
            pictures: raw.pictures.allow_pictures,
            report,
            progress: raw.progress,
            notes,
        })
    }

    /// What a farm is to aim at. Writing the picture takes its share of a time limit.
    pub(crate) fn goal(&self) -> Goal {
        match self.accuracy.goal() {
            Goal::Time { limit, error } => {
                let writing = Duration::from_millis(20) + Duration::from_nanos(80 * self.region.area());
                Goal::Time { limit: limit.saturating_sub(writing), error }
            }
            goal => goal,
        }
    }
}

impl OwnFleet {
    /// Checks what can be known before anything is done.
    pub(crate) fn check(&self, listens: bool) -> Result<(), Failure> {
        match &self.fleet {
            None if self.flags.is_given() => Err(Failure::usage(
                "which engine is to start workers? Give --fleet slurm, pbs, lsf, kubernetes or ssh:FILE",
            )),
            // In a cluster, it listens where the manifests say.
            Some(Engine::Kubernetes) if self.flags.print => Ok(()),
            Some(_) if !listens => {
                Err(Failure::usage("--fleet needs --listen ADDR, where the engine's workers reach this farm"))
            }
            _ => Ok(()),
        }
    }
}

/// Where what is done is kept, of what was asked for; `None` for nowhere.
fn journal_place(asked: Option<PathBuf>, output: &Path) -> Option<PathBuf> {
    match asked {
        Some(path) if path.as_os_str() == "none" => None,
        Some(path) => Some(path),
        None => {
            let mut name = output.as_os_str().to_owned();
            name.push(".journal");
            Some(name.into())
        }
    }
}

/// The scene's name with `.png`, in the current folder.
fn default_output(scene: &Path) -> Result<PathBuf, Failure> {
    let stem = scene.file_stem().ok_or_else(|| {
        Failure::usage(format!("'{}' names no scene file; give one, such as scene.xml", scene.display()))
    })?;
    let mut name = stem.to_os_string();
    name.push(".png");
    Ok(name.into())
}

/// The address that `--listen` means: HOST, HOST:PORT, PORT, :PORT, an IPv6 address with or without brackets.
pub(crate) async fn resolve(listen: &str) -> Result<ListenAddr, Failure> {
    let (host, port) = split(listen).map_err(|why| Failure::usage(format!("--listen {listen}: {why}")))?;
    let failed = |why: &str| {
        Failure::new(Exit::Failed, format!("cannot listen on '{listen}': the host '{host}' does not resolve ({why})"))
    };
    let mut found = tokio::net::lookup_host((host.as_str(), port)).await.map_err(|e| failed(&e.to_string()))?;
    found.next().map(ListenAddr::Socket).ok_or_else(|| failed("no address"))
}

fn split(listen: &str) -> Result<(String, u16), &'static str> {
    if let Ok(addr) = listen.parse::<SocketAddr>() {
        return Ok((addr.ip().to_string(), addr.port()));
    }
    // A number alone is a port, not the address 0.0.19.151.
    if !listen.is_empty() && listen.bytes().all(|b| b.is_ascii_digit()) {
        let port = listen.parse().map_err(|_| "the port must be a number from 0 to 65535")?;
        return Ok(("0.0.0.0".to_owned(), port));
    }
    if let Ok(ip) = listen.trim_start_matches('[').trim_end_matches(']').parse::<std::net::IpAddr>() {
        return Ok((ip.to_string(), DEFAULT_PORT));
    }
    let (host, port) = match listen.rsplit_once(':') {
        None => (listen, DEFAULT_PORT),
        Some((host, port)) => (host, port.parse().map_err(|_| "the port must be a number from 0 to 65535")?),
    };
    if host.contains(':') {
        return Err("write an IPv6 address with a port as [ADDRESS]:PORT");
    }
    Ok((if host.is_empty() { "0.0.0.0" } else { host }.to_owned(), port))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listeners_are_hosts_with_or_without_ports() {
        let ok = |text: &str| split(text).map(|(h, p)| format!("{h} {p}"));
        assert_eq!(ok("0.0.0.0:80").unwrap(), "0.0.0.0 80");
        assert_eq!(ok("::1").unwrap(), "::1 4747");
        assert_eq!(ok("[::1]").unwrap(), "::1 4747");
        assert_eq!(ok("[::1]:5").unwrap(), "::1 5");
        assert_eq!(ok("farm").unwrap(), "farm 4747");
        assert_eq!(ok("farm:9").unwrap(), "farm 9");
        assert_eq!(ok(":9").unwrap(), "0.0.0.0 9");
        assert_eq!(ok("5015").unwrap(), "0.0.0.0 5015");
        assert!(ok("99999").is_err() && ok("farm:99999").is_err() && ok("farm:").is_err() && ok("a:b:1").is_err());
    }
}
