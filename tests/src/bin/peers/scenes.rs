//! The scenes to be rendered, as files.

use std::path::{Path, PathBuf};

use tessera_core::scene::Scene;
use tessera_core::xml::{self, ReadOptions};
use tessera_tests::generate::{self, Document};

use crate::Result;

/// A scene in the format.
#[derive(Debug)]
pub(crate) struct SceneFile {
    /// Its file's name without extension.
    pub(crate) name: String,
    /// Its file, absolute.
    pub(crate) path: PathBuf,
}

impl SceneFile {
    /// The scene.
    ///
    /// # Errors
    /// When it is not valid.
    pub(crate) fn read(&self) -> Result<Scene> {
        Ok(xml::read_file(&self.path, &ReadOptions::default())?.scene)
    }
}

/// A scene made here, and how.
type Made = (&'static str, fn() -> Document);

/// Small ones first; the counts are those of often-used benchmarks.
const MADE: [Made; 9] = [
    ("demo", generate::demo),
    ("mirrors", generate::mirrors),
    ("lights", || generate::lights(1000, 100)),
    ("sphereflake4", || generate::sphereflake(4)),
    ("terrain64", || generate::terrain(64)),
    ("knot-low", || generate::knot_scene(185, 30)),
    ("sphereflake6", || generate::sphereflake(6)),
    ("terrain512", || generate::terrain(512)),
    ("knot", || generate::knot_scene(1815, 240)),
];

/// The scenes called `names`, or all: of folder `from`, or made here and written to `out`.
///
/// # Errors
/// When there is none of a name, or files cannot be read or written.
pub(crate) fn choose(from: Option<&Path>, names: &[String], out: &Path) -> Result<Vec<SceneFile>> {
    let wanted = |name: &str| names.is_empty() || names.iter().any(|n| n == name);
    let there = match from {
        Some(folder) => of_folder(folder)?,
        None => MADE.iter().map(|(n, _)| SceneFile { name: (*n).into(), path: out.join(format!("{n}.xml")) }).collect(),
    };
    if let Some(unknown) = names.iter().find(|n| there.iter().all(|s| s.name != **n)) {
        let names: Vec<&str> = there.iter().map(|s| s.name.as_str()).collect();
        return Err(format!("no scene '{unknown}'; there are: {}", names.join(", ")).into());
    }
    if from.is_none() {
        for (name, document) in MADE.iter().filter(|(n, _)| wanted(n)) {
            document().write(out, name).map_err(|e| format!("cannot write {name}.xml: {e}"))?;
        }
    }
    Ok(there.into_iter().filter(|s| wanted(&s.name)).collect())
}

/// The scenes of a folder, small files first.
fn of_folder(folder: &Path) -> Result<Vec<SceneFile>> {
    let failed = |e| format!("cannot read folder '{}': {e}", folder.display());
    let mut found = Vec::new();
    for entry in folder.canonicalize().and_then(std::fs::read_dir).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|e| e == "xml")
            && let Some(name) = path.file_stem().and_then(|n| n.to_str())
        {
            found.push((std::fs::metadata(&path)?.len(), SceneFile { name: name.to_owned(), path }));
        }
    }
    found.sort_by(|(a, x), (b, y)| a.cmp(b).then_with(|| x.name.cmp(&y.name)));
    if found.is_empty() {
        Err(format!("no .xml in '{}'", folder.display()).into())
    } else {
        Ok(found.into_iter().map(|(_, s)| s).collect())
    }
}
