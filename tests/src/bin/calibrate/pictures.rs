//! Ordinary pictures, and what passes over them come to.

use std::sync::Arc;
use std::time::Instant;

use coordinator::{Goal, SceneSource};
use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::settings::{AuditRate, Detail, Pass, Sampling, Settings, Tolerance};
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::cluster::Cluster;
use tessera_tests::generate::{self, Document, fine};
use tessera_tests::subject::settings;
use tessera_tests::truth::{Pixels, Truth, rmse, truth, whole};

use crate::Result;

/// Pixels across and down.
const SIZE: (u32, u32) = (240, 180);
/// Points a pixel of what is taken for the truth.
const SAMPLES: u32 = 1024;
/// Each time is the least of so many.
const TIMES: u32 = 2;

/// Scenes such as people render.
fn documents() -> Vec<Document> {
    let mut all: Vec<Document> = fine::ORDINARY.iter().map(|(_, scene)| scene(5, SIZE.1)).collect();
    all.extend([generate::demo(), generate::mirrors(), generate::terrain(64), generate::sphereflake(3)]);
    all
}

/// A scene, how it is seen, and what its picture should be.
pub(crate) struct Picture {
    scene: Arc<PreparedScene>,
    settings: Settings,
    tracer: Tracer,
    truth: Truth,
}

/// What a pass came to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shot {
    /// True root mean squared error, without that of the truth.
    pub(crate) rmse: f64,
    /// What the pass says of itself.
    pub(crate) error: ErrorEstimate,
    /// Rays from the camera for each pixel.
    pub(crate) points: f64,
    pub(crate) seconds: f64,
}

impl Picture {
    pub(crate) fn all() -> Result<Vec<Self>> {
        documents().iter().map(Self::new).collect()
    }

    fn new(document: &Document) -> Result<Self> {
        let scene = Arc::new(PreparedScene::build(Arc::new(document.scene()?)));
        let settings = Settings { sampling: Sampling::Adaptive, ..settings(SIZE.0, SIZE.1) };
        let tracer = Tracer::new(Arc::clone(&scene), settings)?;
        let truth = truth(&scene, &settings, SAMPLES);
        Ok(Self { scene, settings, tracer, truth })
    }

    /// Renders all of it within a tolerance of so many steps.
    pub(crate) fn within(&self, steps: f64) -> Shot {
        let pass = pass(steps, AuditRate::default());
        let mut seconds = f64::INFINITY;
        let mut last = None;
        for _ in 0..TIMES {
            let began = Instant::now();
            last = Some(self.tracer.render_pass(whole(&self.settings), pass));
            seconds = seconds.min(began.elapsed().as_secs_f64());
        }
        let (pixels, error, camera) =
            last.map(|(tile, rays)| (tile.pixels, tile.error, rays.camera)).unwrap_or_default();
        let points = camera as f64 / whole(&self.settings).area() as f64;
        Shot { rmse: self.true_error(&pixels), error, points, seconds }
    }

    /// The same in tiles of so many pixels' edge, audited at a rate: rays from the camera for each pixel, and the
    /// estimate. Of every `one_in` tiles across and down one is rendered.
    pub(crate) fn in_tiles(&self, detail: Detail, audit: AuditRate, edge: u32, one_in: u32) -> (f64, ErrorEstimate) {
        let mut tiles = whole(&self.settings).blocks(edge);
        tiles.retain(|r| (r.x0 / edge).is_multiple_of(one_in) && (r.y0 / edge).is_multiple_of(one_in));
        let (mut camera, mut error) = (0, ErrorEstimate::default());
        for tile in &tiles {
            let (tile, rays) = self.tracer.render_pass(*tile, Pass { detail, audit });
            camera += rays.camera;
            error += tile.error;
        }
        let pixels: u64 = tiles.iter().map(Region::area).sum();
        (camera as f64 / pixels.max(1) as f64, error)
    }

    /// Renders with at most an error of so many steps, by a farm: the true error and the upper end of that told, as
    /// shares of what was asked for.
    pub(crate) fn towards(&self, steps: f64) -> Result<(f64, f64)> {
        let mut cluster = Cluster::of(self.scene.scene().as_ref().clone());
        cluster.job.scene = SceneSource::Prepared(Arc::clone(&self.scene));
        cluster.job.settings = self.settings;
        cluster.job.region = whole(&self.settings);
        cluster.job.goal = Goal::Error(steps / 255.0);
        let rendered = cluster.render_unhurried()?;
        let told = rendered.error.unwrap_or_default().interval().1;
        let Some(coordinator::Pixels::F32(pixels)) = rendered.image.into_pixels() else {
            return Err("not floats".into());
        };
        let asked = steps / 255.0;
        Ok((self.true_error(&pixels) / asked, told / asked))
    }

    /// Root mean squared error, without what the truth itself is off by.
    fn true_error(&self, pixels: &Pixels) -> f64 {
        let (found, own) = (rmse(pixels, &self.truth.pixels), self.truth.own);
        (found * found - own * own).max(0.0).sqrt()
    }
}

fn pass(steps: f64, audit: AuditRate) -> Pass {
    Pass { detail: Detail::Within(Tolerance::new(steps / 255.0)), audit }
}
