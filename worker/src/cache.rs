//! Scenes that were fetched, so that none is fetched twice.

use std::sync::{Arc, Mutex, PoisonError};

use tessera_core::trace::PreparedScene;
use tessera_proto::SceneHash;

/// Scenes kept: the one at work, and the one before it.
const KEPT: usize = 2;

/// The last prepared scenes, by content.
#[derive(Debug, Default)]
pub(crate) struct SceneCache(Mutex<Vec<(SceneHash, Arc<PreparedScene>)>>);

impl SceneCache {
    pub(crate) fn get(&self, hash: SceneHash) -> Option<Arc<PreparedScene>> {
        let mut scenes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let at = scenes.iter().position(|(h, _)| *h == hash)?;
        let found = scenes.remove(at);
        scenes.push(found);
        scenes.last().map(|(_, s)| s.clone())
    }

    /// Lets go of the oldest scene, so that there is room for another.
    pub(crate) fn make_room(&self) {
        let mut scenes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if scenes.len() >= KEPT {
            scenes.remove(0);
        }
    }

    pub(crate) fn put(&self, hash: SceneHash, scene: Arc<PreparedScene>) {
        self.make_room();
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push((hash, scene));
    }
}
