//! Parts, in document order, into one scene.

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

use super::diagnostic::Code;
use super::finding::{Finding, Findings, Limits};
use super::part::Part;
use super::source::shown;
use crate::scene::{SceneBuilder, Texture, TextureId, pixmap};

/// What is said of a picture that may not be read.
const ELSEWHERE: &str = "it lies outside the scene's folder; --allow-pictures DIR takes pictures from there too";
/// Samples of all pictures of a scene together.
const MAX_SAMPLES: usize = 2 * Texture::MAX_SAMPLES;

/// Where pictures are.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pictures<'b> {
    /// The scene's folder, from which they are looked up.
    pub base: Option<&'b Path>,
    /// Folders that they may lie in beside it.
    pub more: &'b [PathBuf],
}

/// A scene in the making.
#[derive(Debug)]
pub(super) struct Assembly<'b> {
    pub scene: SceneBuilder,
    pub findings: Findings,
    /// Whether any light was found.
    pub lit: bool,
    /// Whether white space was seen between elements, outside the fast lane.
    pub blank: bool,
    /// Whether reading ended before the text did.
    pub cut: bool,
    pictures: Pictures<'b>,
    /// Real paths of the folders that pictures may lie in; found out when there is a picture.
    folders: Option<Vec<PathBuf>>,
    /// Pictures by name as written; `None` where loading failed.
    by_name: HashMap<String, Option<TextureId>>,
    /// The same by real path: two names of one file are one picture.
    by_path: HashMap<PathBuf, TextureId>,
    samples: usize,
}

impl<'b> Assembly<'b> {
    pub(super) fn new(limits: Limits, pictures: Pictures<'b>) -> Self {
        Self {
            scene: SceneBuilder::new(),
            findings: Findings::new(limits),
            lit: false,
            blank: false,
            cut: false,
            pictures,
            folders: None,
            by_name: HashMap::new(),
            by_path: HashMap::new(),
            samples: 0,
        }
    }

    /// Adds the next part.
    pub(super) fn add(&mut self, mut part: Part) {
        self.lit |= part.lit();
        self.blank |= part.blank;
        let limits = part.findings.limits();
        self.findings.append(std::mem::replace(&mut part.findings, Findings::new(limits)));
        let mut pictures = Vec::with_capacity(part.files.len());
        for (name, at) in std::mem::take(&mut part.files) {
            pictures.extend(self.picture(name, at));
        }
        // Once something is wrong, the rest is only looked through for more.
        if self.findings.errors > 0 {
            return;
        }
        if let Err(invalid) = part.build(&mut self.scene, &pictures) {
            self.findings.push(Finding::new(Code::TooLarge, 0..0, format!("the scene cannot be built: {invalid}")));
        }
    }

    /// The files of the pictures loaded so far, links resolved.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<_> = self.by_path.keys().cloned().collect();
        files.sort();
        files
    }

    fn picture(&mut self, name: String, at: Range<usize>) -> Option<TextureId> {
        if let Some(known) = self.by_name.get(&name) {
            return *known;
        }
        let loaded = self.load(&name);
        let id = match loaded {
            Ok(id) => Some(id),
            Err(why) => {
                self.findings.push_with(super::Severity::Error, || {
                    Finding::new(Code::Texture, at, format!("the picture `{}` cannot be used: {why}", shown(&name)))
                        .expected("a portable pixmap (P3 or P6), named relative to the scene file's folder")
                });
                None
            }
        };
        self.by_name.insert(name, id);
        id
    }

    /// The real path of a picture that may be read. Of what lies elsewhere nothing is told, not even whether it
    /// is there: a scene may come from anybody.
    fn allowed(&mut self, base: &Path, path: &Path) -> Option<PathBuf> {
        let more = self.pictures.more;
        let folders = self.folders.get_or_insert_with(|| {
            std::iter::once(base)
                .chain(more.iter().map(PathBuf::as_path))
                .filter_map(|f| f.canonicalize().ok())
                .collect()
        });
        let inside = |path: &Path| folders.iter().any(|f| path.starts_with(f));
        match path.canonicalize() {
            Ok(real) => inside(&real).then_some(real),
            // It is not there: that may be said of a name that leads nowhere else.
            Err(_) => {
                let plain = path.components().all(|c| !matches!(c, Component::ParentDir));
                let parent = path.ancestors().skip(1).find_map(|p| p.canonicalize().ok());
                (plain && parent.is_some_and(|p| inside(&p))).then(|| path.to_path_buf())
            }
        }
    }

    fn load(&mut self, name: &str) -> Result<TextureId, String> {
        let base = self.pictures.base.ok_or("the scene has no folder to look it up from")?;
        let base = if base.as_os_str().is_empty() { Path::new(".") } else { base };
        let path = base.join(name);
        let Some(real) = self.allowed(base, &path) else { return Err(ELSEWHERE.into()) };
        if let Some(&id) = self.by_path.get(&real) {
            return Ok(id);
        }
        // By its real path: what the name points to by now may be elsewhere.
        let picture = pixmap::load(&real).map_err(|e| e.to_string())?;
        self.samples += 3 * picture.width() as usize * picture.height() as usize;
        if self.samples > MAX_SAMPLES {
            return Err(format!("the scene's pictures together have more than {MAX_SAMPLES} samples"));
        }
        let id = self.scene.texture(picture).map_err(|e| e.to_string())?;
        self.by_path.insert(real, id);
        Ok(id)
    }
}
