//! What a job asks for, checked.

use std::sync::Arc;
use std::time::Duration;

use sha2::{Digest, Sha256};
use tessera_core::film::Region;
use tessera_core::scene::Scene;
use tessera_core::settings::{Sampling, Settings};
use tessera_proto::control::Spec;
use tessera_proto::convert::printable;
use tessera_proto::limits::{BUILD, NUMERIC_MODE};
use tessera_proto::{PixelFormat, SceneHash, wire};

use super::Refused;
use super::choose::Rank;
use crate::config::{Patience, TileSize};
use crate::film::Canvas;
use crate::job::{RenderJob, SceneSource};
use crate::journal::Journal;
use crate::plan::Goal;

/// Bytes of a job's name, and of an owner's and a group's.
const MAX_NAME: usize = 256;
const MAX_OWNER: usize = 64;
/// The highest priority.
const MAX_PRIORITY: i32 = 1000;

/// What a job asks for, in core's types.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Asked {
    pub(crate) scene: (SceneHash, u64),
    pub(crate) settings: Settings,
    pub(crate) region: Region,
    pub(crate) pixels: PixelFormat,
    pub(crate) goal: Goal,
    tile: TileSize,
    verify: f64,
}

fn bad(what: &str) -> Refused {
    Refused::Bad(format!("{what} is out of range"))
}

/// The region that a message names, inside the picture.
pub(crate) fn region_of(region: Option<&wire::Region>, settings: &Settings) -> Option<Region> {
    let &wire::Region { x0, y0, x1, y1 } = region?;
    let whole = Region { x0: 0, y0: 0, x1: settings.view.width(), y1: settings.view.height() };
    Region::new(x0, y0, x1, y1).filter(|r| whole.contains(r))
}

/// Whether a job can be rendered at all, as far as that can be known without its scene.
pub(crate) fn check(spec: &Spec) -> Result<Asked, Refused> {
    let scene = spec.scene.as_ref().ok_or_else(|| bad("the scene"))?;
    let hash: [u8; 32] = scene.sha256.as_slice().try_into().map_err(|_| bad("the scene's hash"))?;
    let settings = Settings::try_from(spec.settings.ok_or_else(|| bad("settings"))?);
    let settings = settings.map_err(|e| Refused::Bad(e.to_string()))?;
    let region = region_of(spec.region.as_ref(), &settings).ok_or_else(|| bad("the region"))?;
    let pixels = PixelFormat::try_from(spec.pixels()).map_err(|e| Refused::Bad(e.to_string()))?;
    let error = spec.max_error;
    if !(error.is_finite() && error >= 0.0) {
        return Err(bad("the error"));
    }
    let error = (error > 0.0).then_some(error);
    let goal = match (spec.time_limit_us, error) {
        (0, None) => Goal::AsSet,
        (0, Some(error)) => Goal::Error(error),
        (limit, error) => Goal::Time { limit: Duration::from_micros(limit), error },
    };
    if (goal == Goal::AsSet) == (settings.sampling == Sampling::Adaptive) {
        return Err(Refused::Bad("an error or a time limit goes with adaptive sampling, and only with that".into()));
    }
    if !(0.0..=1.0).contains(&spec.verify) {
        return Err(bad("the share to be verified"));
    }
    let fits = |text: &str, most: usize| text.len() <= most && printable(text) == text.trim();
    if !fits(&spec.name, MAX_NAME) || !fits(&spec.group, MAX_OWNER) || !fits(&spec.owner, MAX_OWNER) {
        return Err(Refused::Bad("a name is too long, or holds what cannot be printed".into()));
    }
    if spec.owner.trim().is_empty() {
        return Err(bad("the owner"));
    }
    if !(-MAX_PRIORITY..=MAX_PRIORITY).contains(&spec.priority) {
        return Err(bad("the priority"));
    }
    let tile = match spec.tile {
        0 => TileSize::Auto,
        edge @ 1..=TileSize::MAX_EDGE => TileSize::Edge(edge),
        _ => return Err(bad("the tile")),
    };
    Ok(Asked { scene: (SceneHash(hash), scene.bytes), settings, region, pixels, goal, tile, verify: spec.verify })
}

/// A job's place among its owner's.
pub(super) fn rank(spec: &Spec, id: u64) -> Rank {
    (-i64::from(spec.priority), id)
}

/// What the picture depends on, by which a finished one is found again; `None` where time decides.
pub(super) fn key(spec: &Spec) -> Option<[u8; 32]> {
    if spec.time_limit_us > 0 {
        return None;
    }
    let picture = Spec {
        tile: 0,
        verify: 0.0,
        name: String::new(),
        owner: String::new(),
        priority: 0,
        group: String::new(),
        deadline_ms: 0,
        traceparent: String::new(),
        ..spec.clone()
    };
    let mut hash = Sha256::new();
    hash.update(BUILD);
    hash.update([0]);
    hash.update(NUMERIC_MODE);
    hash.update([0]);
    hash.update(prost::Message::encode_to_vec(&picture));
    Some(hash.finalize().into())
}

impl Asked {
    /// The job as a farm renders it. Nobody is in a hurry: it waits for workers for ever.
    pub(super) fn job(&self, scene: Arc<Scene>, journal: Arc<Journal>) -> RenderJob {
        RenderJob {
            region: self.region,
            pixels: self.pixels,
            tile: self.tile,
            workers: 0,
            goal: self.goal,
            verify: self.verify,
            patience: Patience::from(Duration::MAX),
            journal: Some(journal),
            canvas: Some(Canvas::default()),
            ..RenderJob::new(SceneSource::Resolved(scene), self.settings)
        }
    }
}
