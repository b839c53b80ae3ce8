//! Prepared scenes that are kept for later jobs, so that none is fetched or prepared twice.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tessera_core::settings::Settings;
use tessera_core::trace::PreparedScene;
use tessera_proto::SceneHash;

use crate::renderer::TileTracer;

/// Settings of one scene whose tracers are kept.
const TRACERS: usize = 4;

/// A scene and what renders it.
struct Entry<S> {
    hash: SceneHash,
    /// Memory that it may take.
    bytes: u64,
    prepared: Arc<S>,
    tracers: Vec<(Settings, Arc<dyn TileTracer>)>,
}

/// A prepared scene, and its tracer under some settings where that was kept.
pub(crate) type Found<S> = (Arc<S>, Option<Arc<dyn TileTracer>>);

/// The scenes used last, by content, as far as there is room for them.
pub(crate) struct SceneCache<S = PreparedScene> {
    limit: u64,
    /// The one used last at the end.
    scenes: Mutex<Vec<Entry<S>>>,
}

impl<S> SceneCache<S> {
    /// Keeps scenes of `limit` bytes together, and the one at work whatever it takes.
    pub(crate) fn new(limit: u64) -> Self {
        Self { limit, scenes: Mutex::default() }
    }

    fn scenes(&self) -> MutexGuard<'_, Vec<Entry<S>>> {
        self.scenes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The prepared scene, and its tracer under `settings`, as far as they are here.
    pub(crate) fn get(&self, hash: SceneHash, settings: &Settings) -> Option<Found<S>> {
        let mut scenes = self.scenes();
        let at = scenes.iter().position(|e| e.hash == hash)?;
        let entry = scenes.remove(at);
        let tracer = entry.tracers.iter().find(|(s, _)| s == settings).map(|(_, tracer)| tracer.clone());
        let found = (entry.prepared.clone(), tracer);
        scenes.push(entry);
        Some(found)
    }

    /// Forgets the scenes used longest ago until another of so many bytes has room beside the rest.
    pub(crate) fn make_room(&self, bytes: u64) {
        let mut scenes = self.scenes();
        let mut sum = scenes.iter().fold(bytes, |sum, e| sum.saturating_add(e.bytes));
        while sum > self.limit && !scenes.is_empty() {
            sum = sum.saturating_sub(scenes.remove(0).bytes);
        }
    }

    /// Keeps a scene that may take so many bytes.
    pub(crate) fn put(&self, hash: SceneHash, bytes: u64, prepared: Arc<S>) {
        self.make_room(bytes);
        let mut scenes = self.scenes();
        scenes.retain(|e| e.hash != hash);
        scenes.push(Entry { hash, bytes, prepared, tracers: Vec::new() });
    }

    /// Keeps what renders a scene that is kept.
    pub(crate) fn put_tracer(&self, hash: SceneHash, settings: Settings, tracer: Arc<dyn TileTracer>) {
        let mut scenes = self.scenes();
        let Some(entry) = scenes.iter_mut().find(|e| e.hash == hash) else { return };
        entry.tracers.retain(|(s, _)| *s != settings);
        if entry.tracers.len() >= TRACERS {
            entry.tracers.remove(0);
        }
        entry.tracers.push((settings, tracer));
    }

    /// Lets go of a scene that no job needs any more.
    pub(crate) fn forget(&self, hash: SceneHash) {
        self.scenes().retain(|e| e.hash != hash);
    }
}

#[cfg(test)]
mod tests {
    use tessera_core::settings::{Sampling, Transfer, View};

    use super::*;

    #[test]
    fn the_scenes_used_last_stay_and_what_is_forgotten_goes() {
        let (cache, scene) = (SceneCache::new(100), Arc::new(()));
        let settings = Settings {
            view: View::new(8, 8, 1.0, 1.0).unwrap(),
            max_depth: 1,
            sampling: Sampling::Uniform { grid: 1 },
            transfer: Transfer::Srgb,
        };
        let hash = |n| SceneHash([n; 32]);
        let has = |n| cache.get(hash(n), &settings).is_some();
        for n in 1..=3 {
            cache.put(hash(n), 30, scene.clone());
        }
        assert!(has(1));
        // The fourth takes the place of the one that was not used for the longest time.
        cache.put(hash(4), 30, scene.clone());
        assert!(!has(2) && has(1) && has(3) && has(4));
        cache.forget(hash(3));
        assert!(!has(3));
        // One alone may be larger than all that is kept.
        cache.put(hash(5), 1000, scene);
        assert!(has(5) && !has(1) && !has(4));
    }
}
