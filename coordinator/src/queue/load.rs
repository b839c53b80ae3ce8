//! A job made ready to be rendered, and what is kept of it when it was.

use std::sync::Arc;
use std::time::Duration;

use tessera_core::scene::Scene;
use tessera_proto::control::{self, Result as Outcome};
use tessera_proto::convert::Lease;
use tessera_proto::limits::SCENE_PIECE_BYTES;
use tessera_proto::scene::SceneDecoder;
use tessera_proto::{Attempt, LeaseId, PassNumber, SceneHash};

use super::micros;
use super::spec::Asked;
use super::store::Store;
use crate::job::{RenderJob, Rendered};
use crate::journal::Journal;

/// Workers of a picture that are kept with it.
const WORKERS: usize = 100;

/// A job made ready to be rendered.
pub(super) struct Loaded {
    pub(super) job: RenderJob,
    pub(super) journal: Arc<Journal>,
    pub(super) scene: (SceneHash, u64),
}

/// Reads a job's scene, and what an earlier run left of it.
pub(super) fn load(store: &Store, id: u64, asked: &Asked) -> Result<Loaded, String> {
    let path = store.scene(asked.scene.0);
    let scene = Arc::new(read_scene(&path, asked.scene.1).map_err(|e| format!("its scene cannot be read: {e}"))?);
    let path = store.journal(id);
    let open = |restart| Journal::open(&path, restart).map(|j| j.after(Duration::ZERO)).map_err(|e| e.to_string());
    let mut journal = match open(false) {
        Ok(journal) => Arc::new(journal),
        Err(why) => {
            tracing::warn!("job {id} begins anew: {why}");
            Arc::new(open(true)?)
        }
    };
    let mut job = asked.job(scene, journal.clone());
    job.scratch.folder = journal.path().parent().map(Into::into);
    if journal.goes_on()
        && let Err(why) = journal.check(&job.head())
    {
        tracing::warn!("job {id} begins anew: {why}");
        // Its file has to be let go of first.
        job.journal = None;
        drop(journal);
        journal = Arc::new(open(true)?);
        job.journal = Some(journal.clone());
    }
    Ok(Loaded { job, journal, scene: asked.scene })
}

/// Reads a scene's binary form, `bytes` long.
fn read_scene(path: &std::path::Path, bytes: u64) -> Result<Scene, String> {
    let mut file = std::fs::File::open(path).map_err(|e| e.to_string())?;
    let mut decoder = SceneDecoder::new(bytes).map_err(|e| e.to_string())?;
    let mut piece = vec![0; SCENE_PIECE_BYTES];
    loop {
        let read = std::io::Read::read(&mut file, &mut piece).map_err(|e| e.to_string())?;
        if read == 0 {
            break;
        }
        decoder.push(&piece[..read]).map_err(|e| e.to_string())?;
    }
    decoder.finish().map_err(|e| e.to_string())
}

/// What is kept of a finished render beside its pixels.
pub(super) fn outcome(rendered: &Rendered, hash: [u8; 32]) -> Outcome {
    let mut workers: Vec<_> = rendered.workers.iter().filter(|w| w.tiles > 0).collect();
    workers.sort_by_key(|w| std::cmp::Reverse(w.pixels));
    let lease = |pass| Lease {
        id: LeaseId(0),
        attempt: Attempt(0),
        region: rendered.region,
        number: PassNumber(0),
        pass: Some(pass),
    };
    Outcome {
        pixels_sha256: hash.to_vec(),
        rays: Some(rendered.rays.into()),
        error: rendered.error.map(Into::into),
        target_met: rendered.target_met,
        passes: rendered.passes,
        timed_out: rendered.timed_out,
        trace_us: micros(rendered.trace),
        tiles: rendered.tiles,
        pass: rendered.pass.map(|pass| lease(pass).into()),
        workers: workers
            .into_iter()
            .take(WORKERS)
            .map(|w| control::Worker {
                name: w.name.clone(),
                address: w.address.clone(),
                threads: w.threads,
                tiles: w.tiles,
                pixels: w.pixels,
                rays: w.rays.total(),
                busy_us: micros(w.busy),
                lost: w.lost,
                verified: w.verified,
                ..control::Worker::default()
            })
            .collect(),
    }
}
