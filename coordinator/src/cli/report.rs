//! The report of a render: JSON whose named keys scripts rely on.

use std::time::Duration;

use coordinator::{Rendered, TileSize, WorkerStats};
use serde::Serialize;
use tessera_core::film::Region;
use tessera_core::settings::{Sampling, Transfer};
use tessera_core::trace::RayCounts;
use tessera_proto::limits::{BUILD, NUMERIC_MODE};

use super::describe::Description;
use super::options::{Accuracy as Wanted, Options};

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
    quality: Option<&'static str>,
    target: Option<f64>,
    time_limit: Option<f64>,
    timed_out: bool,
    target_met: Option<bool>,
    /// What one part of a pixel's error may be.
    tolerance: Option<f64>,
    passes: u32,
    estimated_rmse: Option<f64>,
    estimated_rmse_8bit_steps: Option<f64>,
    estimated_worst_pixel: Option<f64>,
    /// Sum of the pixels' expected squared errors.
    estimated_squares: Option<f64>,
    parts: Option<Parts>,
    max_depth: u32,
}

/// The part that each approximation has in the error, as root mean squares.
#[derive(Debug, Serialize)]
struct Parts {
    /// Of where samples are.
    samples_rmse: f64,
    /// Of paths not followed because they carry too little.
    weight_rmse: f64,
    /// Not in the estimate: a bound on what lies deeper than the greatest depth.
    depth_bound: f64,
}

impl Accuracy {
    fn new(options: &Options, rendered: &Rendered) -> Self {
        let (error, rmse) = (rendered.error, rendered.error.map(|e| e.rmse()));
        let (quality, target, time_limit) = match options.accuracy {
            Wanted::Samples(_) => (None, None, None),
            Wanted::Quality(q) => (Some(q.name()), None, None),
            Wanted::Error(e) => (None, Some(e), None),
            Wanted::Time { limit, error } => (None, error, Some(limit.as_secs_f64())),
        };
        Self {
            method: if rendered.tolerance.is_some() { "adaptive" } else { "uniform" },
            samples_per_pixel: match options.settings.sampling {
                Sampling::Uniform { grid } => Some(grid * grid),
                Sampling::Adaptive { .. } => None,
            },
            quality,
            target,
            time_limit,
            timed_out: rendered.timed_out,
            target_met: target.zip(rmse).map(|(target, rmse)| rmse <= target),
            tolerance: rendered.tolerance.map(|t| t.fraction()),
            passes: rendered.passes,
            estimated_rmse: rmse,
            estimated_rmse_8bit_steps: rmse.map(|e| 255.0 * e),
            estimated_worst_pixel: error.map(|e| e.worst_pixel()),
            parts: error.map(|e| Parts {
                samples_rmse: e.samples_rmse(),
                weight_rmse: e.weight_rmse(),
                depth_bound: e.depth_bound(),
            }),
            estimated_squares: error.map(|e| e.rmse() * e.rmse() * e.pixels as f64),
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

/// The word for `transfer`, as flags spell it.
pub(crate) fn transfer_name(transfer: Transfer) -> &'static str {
    match transfer {
        Transfer::Srgb => "srgb",
        Transfer::Linear => "linear",
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
                    Sampling::Adaptive { .. } => None,
                },
                transfer: transfer_name(options.settings.transfer),
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
