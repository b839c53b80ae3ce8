//! The report of a render: JSON whose named keys scripts rely on.

use std::time::Duration;

use coordinator::{Rendered, TileSize, WorkerStats};
use serde::Serialize;
use tessera_core::film::Region;
use tessera_core::settings::{Detail, Sampling};
use tessera_core::trace::RayCounts;
use tessera_proto::limits::{BUILD, NUMERIC_MODE};

use super::describe::Description;
use super::options::{Accuracy as Wanted, Options};
use super::verification::VerificationReport;

/// Wall-clock time by phase.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Phases {
    /// Reading and checking the scene.
    pub(crate) read: Duration,
    /// Building structures in this process.
    pub(crate) build: Duration,
    /// Encoding and writing the picture.
    pub(crate) write: Duration,
}

#[derive(Debug, Serialize)]
pub(crate) struct Report<'a> {
    program: &'static str,
    version: &'static str,
    /// What workers and journals are held to.
    build: &'static str,
    numeric_mode: &'static str,
    complete: bool,
    output: String,
    pixels_sha256: Option<String>,
    seconds: Seconds,
    rays: Rays,
    accuracy: Accuracy,
    tiles: u64,
    earlier: Earlier,
    workers: Vec<Worker<'a>>,
    verification: Option<VerificationReport<'a>>,
    /// Calls without the farm's token or a certificate.
    refused_calls: u64,
    scene: &'a Description,
    settings: SettingsReport,
}

#[derive(Debug, Serialize)]
struct Seconds {
    read: f64,
    build: f64,
    trace: f64,
    write: f64,
    total: f64,
}

#[derive(Debug, Serialize)]
struct Rays {
    camera: u64,
    mirror: u64,
    shadow: u64,
    total: u64,
    refined: u64,
    unresolved: u64,
    per_second: f64,
}

/// What of the tiles and rays an earlier run did, which this one found in its journal.
#[derive(Debug, Serialize)]
struct Earlier {
    tiles: u64,
    rays: u64,
}

/// What is known of the picture's error. Errors are fractions of full scale.
#[derive(Debug, Serialize)]
struct Accuracy {
    method: &'static str,
    samples_per_pixel: Option<u32>,
    pattern: Option<&'static str>,
    quality: Option<&'static str>,
    target: Option<f64>,
    time_limit: Option<f64>,
    timed_out: bool,
    target_met: Option<bool>,
    /// What a typical edge pixel's error may be, in the last pass over all pixels.
    tolerance: Option<f64>,
    /// One point in squares of so many pixels, where that pass was no closer.
    coarse_step: Option<u32>,
    passes: u32,
    estimated_rmse: Option<f64>,
    estimated_rmse_8bit_steps: Option<f64>,
    /// The 95 % interval of that.
    interval: Option<[f64; 2]>,
    interval_8bit_steps: Option<[f64; 2]>,
    /// What the sampler believed.
    expected_rmse: Option<f64>,
    audited_pixels: Option<u64>,
    max_depth: u32,
}

impl Accuracy {
    fn new(options: &Options, rendered: &Rendered) -> Self {
        let error = rendered.error.filter(|e| e.audited > 0);
        let (rmse, interval) = (error.map(|e| e.rmse()), error.map(|e| e.interval()).map(<[f64; 2]>::from));
        let detail = rendered.pass.map(|p| p.detail);
        let (samples_per_pixel, pattern) = match options.settings.sampling {
            Sampling::Uniform { grid } => (Some(grid * grid), Some("grid")),
            Sampling::Scrambled { samples } => (Some(samples), Some("scrambled")),
            Sampling::Adaptive => (None, None),
        };
        Self {
            method: if samples_per_pixel.is_some() { "uniform" } else { "adaptive" },
            samples_per_pixel,
            pattern,
            quality: match options.accuracy {
                Wanted::Quality(q) => Some(q.name()),
                _ => None,
            },
            target: options.accuracy.target(),
            time_limit: match options.accuracy {
                Wanted::Time { limit, .. } => Some(limit.as_secs_f64()),
                _ => None,
            },
            timed_out: rendered.timed_out,
            target_met: rendered.target_met,
            tolerance: match detail {
                Some(Detail::Within(tolerance)) => Some(tolerance.fraction()),
                _ => None,
            },
            coarse_step: match detail {
                Some(Detail::Coarse { step }) => Some(step),
                _ => None,
            },
            passes: rendered.passes,
            estimated_rmse: rmse,
            estimated_rmse_8bit_steps: rmse.map(|e| 255.0 * e),
            interval,
            interval_8bit_steps: interval.map(|ends| ends.map(|e| 255.0 * e)),
            expected_rmse: error.map(|e| e.expected_rmse()),
            audited_pixels: rendered.error.map(|e| e.audited),
            max_depth: options.settings.max_depth,
        }
    }
}

#[derive(Debug, Serialize)]
struct Worker<'a> {
    name: &'a str,
    address: &'a str,
    threads: u32,
    tiles: u64,
    pixels: u64,
    lost: u64,
    busy_seconds: f64,
    rays: Rays,
    left: Option<&'a str>,
}

#[derive(Debug, Serialize)]
struct SettingsReport {
    width: u32,
    height: u32,
    region: [u32; 4],
    zoom: f64,
    plane_height: f64,
    max_depth: u32,
    samples: Option<u32>,
    transfer: &'static str,
    bits: Option<u8>,
    tile: Option<u32>,
    workers: usize,
    threads: usize,
}

fn per_second(count: u64, over: Duration) -> f64 {
    let seconds = over.as_secs_f64();
    if seconds > 0.0 { count as f64 / seconds } else { 0.0 }
}

impl Rays {
    fn new(rays: &RayCounts, over: Duration) -> Self {
        let total = rays.total();
        Self {
            camera: rays.camera,
            mirror: rays.mirror,
            shadow: rays.shadow,
            total,
            refined: rays.refined,
            unresolved: rays.unresolved,
            per_second: per_second(total, over),
        }
    }
}

impl<'a> Worker<'a> {
    fn new(w: &'a WorkerStats) -> Self {
        Self {
            name: &w.name,
            address: &w.address,
            threads: w.threads,
            tiles: w.tiles,
            pixels: w.pixels,
            lost: w.lost,
            busy_seconds: w.busy.as_secs_f64(),
            rays: Rays::new(&w.rays, w.busy),
            left: w.left.as_deref(),
        }
    }
}

impl<'a> Report<'a> {
    /// The report of `rendered`, written to `output`. The hash is `None` where no floats were asked for.
    pub(crate) fn new(
        options: &Options,
        (output, pixels_sha256): (String, Option<String>),
        scene: &'a Description,
        rendered: &'a Rendered,
        phases: &Phases,
        total: Duration,
    ) -> Self {
        let view = options.settings.view;
        let Region { x0, y0, x1, y1 } = options.region;
        Self {
            program: "coordinator",
            version: env!("CARGO_PKG_VERSION"),
            build: BUILD,
            numeric_mode: NUMERIC_MODE,
            complete: rendered.is_complete(),
            output,
            pixels_sha256,
            seconds: Seconds {
                read: phases.read.as_secs_f64(),
                build: phases.build.as_secs_f64(),
                trace: rendered.trace.as_secs_f64(),
                write: phases.write.as_secs_f64(),
                total: total.as_secs_f64(),
            },
            rays: Rays {
                per_second: per_second(rendered.rays.total() - rendered.earlier.rays.total(), rendered.trace),
                ..Rays::new(&rendered.rays, rendered.trace)
            },
            accuracy: Accuracy::new(options, rendered),
            tiles: rendered.tiles,
            earlier: Earlier { tiles: rendered.earlier.tiles, rays: rendered.earlier.rays.total() },
            workers: rendered.workers.iter().map(Worker::new).collect(),
            verification: VerificationReport::new(&rendered.verification),
            refused_calls: rendered.strangers,
            scene,
            settings: SettingsReport {
                width: view.width(),
                height: view.height(),
                region: [x0, y0, x1, y1],
                zoom: view.zoom(),
                plane_height: view.plane_height(),
                max_depth: options.settings.max_depth,
                samples: match options.settings.sampling {
                    Sampling::Uniform { grid } => Some(grid * grid),
                    Sampling::Scrambled { samples } => Some(samples),
                    Sampling::Adaptive => None,
                },
                transfer: options.settings.transfer.name(),
                bits: options.output.depth().map(|d| d.bits()),
                tile: match options.tile {
                    TileSize::Auto => None,
                    TileSize::Edge(n) => Some(n),
                },
                workers: options.workers,
                threads: options.threads,
            },
        }
    }

    /// The text of the file.
    pub(crate) fn to_text(&self) -> Result<String, serde_json::Error> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}
