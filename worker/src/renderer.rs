//! What renders tiles: the tracer, or in tests something slower.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use tessera_core::film::{Region, Tile};
use tessera_core::settings::{Pass, Settings};
use tessera_core::trace::{PrepareError, PreparedScene, RayCounts, Tracer};

/// Sets up tracers.
pub trait RendererFactory: Send + Sync + fmt::Debug {
    /// What renders `scene` under `settings`.
    ///
    /// # Errors
    /// When the settings cannot be had.
    fn open(&self, scene: Arc<PreparedScene>, settings: Settings) -> Result<Arc<dyn TileTracer>, PrepareError>;
}

/// Renders regions of one picture.
pub trait TileTracer: Send + Sync {
    /// The pixels of `region`, in one `pass` of an adaptive picture or by uniform sampling. Once `unwanted` is set,
    /// nobody looks at them, and the sooner this ends the better.
    fn render_wanted(&self, region: Region, pass: Option<Pass>, unwanted: &Arc<AtomicBool>) -> (Tile, RayCounts) {
        let _ = unwanted;
        match pass {
            Some(pass) => self.render_pass(region, pass),
            None => self.render(region),
        }
    }

    /// The pixels of `region` by uniform sampling, on the calling rayon pool.
    fn render(&self, region: Region) -> (Tile, RayCounts);

    /// The pixels of `region` in one pass of an adaptive picture, and their errors.
    fn render_pass(&self, region: Region, _pass: Pass) -> (Tile, RayCounts) {
        self.render(region)
    }
}

/// The project's tracer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Exact;

impl RendererFactory for Exact {
    fn open(&self, scene: Arc<PreparedScene>, settings: Settings) -> Result<Arc<dyn TileTracer>, PrepareError> {
        Ok(Arc::new(Tracer::new(scene, settings)?))
    }
}

impl TileTracer for Tracer {
    fn render_wanted(&self, region: Region, pass: Option<Pass>, unwanted: &Arc<AtomicBool>) -> (Tile, RayCounts) {
        let tracer = self.until(Arc::clone(unwanted));
        match pass {
            Some(pass) => tracer.render_pass(region, pass),
            None => tracer.render(region),
        }
    }

    fn render(&self, region: Region) -> (Tile, RayCounts) {
        Self::render(self, region)
    }

    fn render_pass(&self, region: Region, pass: Pass) -> (Tile, RayCounts) {
        Self::render_pass(self, region, pass)
    }
}
