//! POV-Ray's default anti-aliasing on the same scene, where it is installed.

use std::process::{Command, Stdio};

use tempfile::TempDir;
use tessera_tests::peers::povray_installed;

use crate::Result;
use crate::run::Scene;

/// A scene in POV-Ray's language, in a folder of its own.
pub(crate) struct Export {
    folder: TempDir,
    size: (u32, u32),
    threads: usize,
}

impl Export {
    /// `None` where there is no POV-Ray.
    pub(crate) fn new(scene: &Scene, threads: usize) -> Result<Option<Self>> {
        if !povray_installed() {
            return Ok(None);
        }
        let folder = tempfile::tempdir()?;
        coordinator::povray::export(scene.prepared.scene(), &scene.settings, folder.path(), "scene")?;
        let view = &scene.settings.view;
        Ok(Some(Self { folder, size: (view.width(), view.height()), threads }))
    }

    /// Its own trace time; `None` where it fails or tells none.
    pub(crate) fn seconds(&self) -> Option<f64> {
        let out = Command::new("povray")
            .args(["+Iscene.pov", "+Oscene.png", "+FN8", "-D", "-V", "File_Gamma=1.0", "+A0.3", "+AM1", "+R3"])
            .arg(format!("+W{}", self.size.0))
            .arg(format!("+H{}", self.size.1))
            .arg(format!("+WT{}", self.threads))
            .current_dir(self.folder.path())
            .stdin(Stdio::null())
            .output()
            .ok()?;
        // "  Trace Time:       0 hours  0 minutes  1 seconds (1.234 seconds)"
        let text = String::from_utf8_lossy(&out.stderr);
        let line = text.lines().find(|l| l.trim_start().starts_with("Trace Time"))?;
        line.rsplit_once('(')?.1.split_whitespace().next()?.parse().ok()
    }
}
