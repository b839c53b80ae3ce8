//! Renders by a farm in this process.

use std::path::Path;
use std::sync::Arc;

use coordinator::{Goal, SceneSource};
use tessera_core::settings::{Sampling, Settings};
use tessera_core::trace::PreparedScene;
use tessera_core::xml::{ReadOptions, read_file};
use tessera_tests::cluster::Cluster;
use tessera_tests::truth::{Pixels, Truth, truth, whole};

use crate::Result;

/// What is rendered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Setting {
    /// So many points along a pixel's edge.
    Grid(u32),
    /// As many scrambled points.
    Scrambled(u32),
    /// At most an error of so many 8-bit steps.
    Error(f64),
}

impl Setting {
    pub(crate) fn name(self) -> String {
        match self {
            Self::Grid(n) => format!("grid {}", n * n),
            Self::Scrambled(n) => format!("scrambled {}", n * n),
            Self::Error(steps) => format!("max-error {steps}"),
        }
    }
}

/// A picture, and what it cost.
pub(crate) struct Picture {
    pub(crate) pixels: Pixels,
    pub(crate) rays: u64,
    pub(crate) seconds: f64,
    /// The error that it tells of itself, in 8-bit steps.
    pub(crate) told: Option<f64>,
}

/// A scene, and how it is seen.
pub(crate) struct Scene {
    pub(crate) name: String,
    pub(crate) prepared: Arc<PreparedScene>,
    pub(crate) settings: Settings,
    threads: usize,
}

impl Scene {
    pub(crate) fn read(path: &Path, settings: Settings, threads: usize) -> Result<Self> {
        let scene = read_file(path, &ReadOptions::default()).map_err(|e| format!("{}: {e}", path.display()))?.scene;
        let name = path.file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy().into_owned());
        Ok(Self { name, prepared: Arc::new(PreparedScene::build(Arc::new(scene))), settings, threads })
    }

    /// The reference: from `folder`, or rendered and left there.
    pub(crate) fn truth(&self, folder: &Path, samples: u32) -> Result<Truth> {
        let view = &self.settings.view;
        let depth = self.settings.max_depth;
        let name = format!("{}-{}x{}-{depth}-{samples}.truth", self.name, view.width(), view.height());
        let path = folder.join(name);
        let floats = 3 * view.width() as usize * view.height() as usize;
        // Its own error, then the pixels, all as little-endian f32.
        if let Ok(bytes) = std::fs::read(&path) {
            let numbers: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
            if let [own, rest @ ..] = &numbers[..]
                && rest.len() == floats
            {
                return Ok(Truth { pixels: rest.as_chunks::<3>().0.to_vec(), own: f64::from(*own) });
            }
        }
        let truth = truth(&self.prepared, &self.settings, samples);
        let numbers = std::iter::once(truth.own as f32).chain(truth.pixels.as_flattened().iter().copied());
        std::fs::write(&path, numbers.flat_map(f32::to_le_bytes).collect::<Vec<u8>>())?;
        Ok(truth)
    }

    /// Renders once, as `coordinator render` does.
    pub(crate) fn render(&self, setting: Setting) -> Result<Picture> {
        let mut cluster = Cluster::of(self.prepared.scene().as_ref().clone());
        let (sampling, goal) = match setting {
            Setting::Grid(grid) => (Sampling::Uniform { grid }, Goal::AsSet),
            Setting::Scrambled(n) => (Sampling::Scrambled { samples: n * n }, Goal::AsSet),
            Setting::Error(steps) => (Sampling::Adaptive, Goal::Error(steps / 255.0)),
        };
        cluster.job.scene = SceneSource::Prepared(Arc::clone(&self.prepared));
        cluster.job.settings = Settings { sampling, ..self.settings };
        cluster.job.region = whole(&self.settings);
        cluster.job.threads = self.threads;
        cluster.job.goal = goal;
        let rendered = cluster.render_unhurried()?;
        let Some(coordinator::Pixels::F32(pixels)) = rendered.image.into_pixels() else {
            return Err("not floats".into());
        };
        Ok(Picture {
            pixels,
            rays: rendered.rays.camera + rendered.rays.mirror + rendered.rays.shadow,
            seconds: rendered.trace.as_secs_f64(),
            told: rendered.error.map(|e| 255.0 * e.rmse()),
        })
    }
}
