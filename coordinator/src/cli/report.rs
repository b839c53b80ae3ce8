//! The report of a render: JSON whose named keys scripts rely on.

use std::time::Duration;

use coordinator::{Pixels, Rendered, TileSize, WorkerStats};
use serde::Serialize;
use tessera_core::film::{Region, pixels_sha256};
use tessera_core::settings::{Sampling, Transfer};
use tessera_core::trace::RayCounts;

use super::describe::Description;
use super::options::Options;

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
    complete: bool,
    output: String,
    pixels_sha256: Option<String>,
    seconds: Seconds,
    rays: Rays,
    accuracy: Accuracy,
    tiles: u64,
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

/// What is known of the picture's error.
#[derive(Debug, Serialize)]
struct Accuracy {
    method: &'static str,
    samples_per_pixel: u32,
    max_depth: u32,
    target: Option<f64>,
    estimated_rmse: Option<f64>,
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
    samples: u32,
    transfer: &'static str,
    bits: Option<u8>,
    tile: Option<u32>,
    workers: usize,
    threads: usize,
}

impl Rays {
    fn new(rays: &RayCounts, over: Duration) -> Self {
        let total = rays.camera + rays.mirror + rays.shadow;
        let seconds = over.as_secs_f64();
        Self {
            camera: rays.camera,
            mirror: rays.mirror,
            shadow: rays.shadow,
            total,
            refined: rays.refined,
            unresolved: rays.unresolved,
            per_second: if seconds > 0.0 { total as f64 / seconds } else { 0.0 },
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
    /// The report of `rendered`. The hash is `None` where no floats were asked for.
    pub(crate) fn new(
        options: &Options,
        output: String,
        scene: &'a Description,
        rendered: &'a Rendered,
        phases: &Phases,
        total: Duration,
    ) -> Self {
        let Sampling::Uniform { grid } = options.settings.sampling;
        let view = options.settings.view;
        let Region { x0, y0, x1, y1 } = options.region;
        Self {
            program: "coordinator",
            version: env!("CARGO_PKG_VERSION"),
            complete: rendered.is_complete(),
            output,
            pixels_sha256: match &rendered.image {
                Pixels::F32(pixels) => Some(pixels_sha256(pixels)),
                _ => None,
            },
            seconds: Seconds {
                read: phases.read.as_secs_f64(),
                build: phases.build.as_secs_f64(),
                trace: rendered.trace.as_secs_f64(),
                write: phases.write.as_secs_f64(),
                total: total.as_secs_f64(),
            },
            rays: Rays::new(&rendered.rays, rendered.trace),
            accuracy: Accuracy {
                method: "uniform",
                samples_per_pixel: grid * grid,
                max_depth: options.settings.max_depth,
                target: None,
                estimated_rmse: None,
            },
            tiles: rendered.tiles,
            workers: rendered.workers.iter().map(Worker::new).collect(),
            scene,
            settings: SettingsReport {
                width: view.width(),
                height: view.height(),
                region: [x0, y0, x1, y1],
                zoom: view.zoom(),
                plane_height: view.plane_height(),
                max_depth: options.settings.max_depth,
                samples: grid * grid,
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
