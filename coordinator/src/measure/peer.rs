//! POV-Ray's anti-aliasing, beside ours.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use tessera_core::film::{Image, file};
use tessera_core::scene::Scene;
use tessera_core::settings::Settings;
use tokio::process::Command;

use super::point::Rays;
use crate::povray;

/// Why POV-Ray gave no picture.
#[derive(Debug, thiserror::Error)]
pub enum PeerError {
    /// It is not there.
    #[error("POV-Ray is not installed: there is no 'povray' in PATH; install it, or leave --peers out")]
    Missing,
    /// It does not start, or fails.
    #[error("POV-Ray failed: {0}")]
    Failed(String),
}

/// A setting of POV-Ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rung {
    /// As its command line has it.
    pub(super) flags: &'static [&'static str],
    /// What it costs, roughly, in our renders of one sample a pixel.
    pub(super) cost: f64,
}

impl Rung {
    /// What tables call it.
    pub(super) fn value(&self) -> String {
        self.flags.join(" ")
    }
}

/// From none to its finest; the second is its default.
pub(super) const LADDER: [Rung; 5] = [
    Rung { flags: &["-A"], cost: 8.0 },
    Rung { flags: &["+A0.3", "+AM1", "+R3"], cost: 15.0 },
    Rung { flags: &["+A0.1", "+AM2", "+R3"], cost: 25.0 },
    Rung { flags: &["+A0.03", "+AM2", "+R4"], cost: 60.0 },
    Rung { flags: &["+A0.01", "+AM2", "+R5"], cost: 200.0 },
];

/// What a run gave.
#[derive(Debug)]
pub(super) struct Ran {
    /// Its own trace time.
    pub(super) trace: Duration,
    /// From start to end.
    pub(super) whole: Duration,
    /// What it says of its rays.
    pub(super) rays: Option<Rays>,
    /// Linear, clamped to [0, 1].
    pub(super) image: Image,
}

/// Makes sure that POV-Ray answers.
///
/// # Errors
/// When it does not.
pub async fn installed() -> Result<(), PeerError> {
    let asked = Command::new("povray").arg("--version").stdin(Stdio::null()).output().await;
    match asked {
        Ok(_) => Ok(()),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Err(PeerError::Missing),
        Err(e) => Err(PeerError::Failed(e.to_string())),
    }
}

/// A scene in POV-Ray's language, in a folder of its own.
#[derive(Debug)]
pub(super) struct Exported {
    folder: PathBuf,
    size: (u32, u32),
    threads: usize,
}

impl Exported {
    /// Writes the scene into the empty folder given.
    pub(super) fn write(scene: &Scene, settings: &Settings, threads: usize, folder: &Path) -> std::io::Result<Self> {
        povray::export(scene, settings, folder, "scene")?;
        let size = (settings.view.width(), settings.view.height());
        Ok(Self { folder: folder.into(), size, threads: threads.max(1) })
    }

    /// Renders it once. The process ends with this future.
    pub(super) async fn run(&self, rung: &Rung) -> Result<Ran, PeerError> {
        let failed = |e: &dyn std::fmt::Display| PeerError::Failed(e.to_string());
        let began = Instant::now();
        let told = Command::new("povray")
            // 16 bits and a gamma of 1: what it writes is linear.
            .args(["+Iscene.pov", "+Oout.png", "+FN16", "-D", "-V", "File_Gamma=1.0"])
            .arg(format!("+W{}", self.size.0))
            .arg(format!("+H{}", self.size.1))
            .arg(format!("+WT{}", self.threads))
            .args(rung.flags)
            .current_dir(&self.folder)
            .stdin(Stdio::null())
            .kill_on_drop(true)
            .output()
            .await
            .map_err(|e| failed(&e))?;
        let whole = began.elapsed();
        let text = String::from_utf8_lossy(&told.stderr);
        if !told.status.success() {
            let lines: Vec<&str> = text.lines().filter(|l| !l.trim().is_empty()).collect();
            let last = lines[lines.len().saturating_sub(3)..].join(" | ");
            return Err(PeerError::Failed(format!("{}: {last}", told.status)));
        }
        let trace = trace_time(&text).ok_or_else(|| failed(&"it did not say how long it traced"))?;
        let stored = file::read(&self.folder.join("out.png")).map_err(|e| failed(&e))?;
        if (stored.image.width(), stored.image.height()) != self.size {
            return Err(failed(&"its picture has another size"));
        }
        Ok(Ran { trace, whole, rays: rays(&text), image: stored.image })
    }
}

/// `Trace Time: 0 hours 1 minutes 0 seconds (60.639 seconds)`.
fn trace_time(text: &str) -> Option<Duration> {
    let line = text.lines().find(|l| l.contains("Trace Time"))?;
    let seconds = line.split_once('(')?.1.split_whitespace().next()?.parse().ok()?;
    Duration::try_from_secs_f64(seconds).ok()
}

/// `Rays: 34 Saved: 0 Max Level: 3/6` and, where there are any, `Reflected Rays: 5`. Its count
/// of shadow tests is one of objects, not of rays.
fn rays(text: &str) -> Option<Rays> {
    let number = |key: &str| -> Option<u64> {
        let line = text.lines().find(|l| l.starts_with(key))?;
        line[key.len()..].split_whitespace().next()?.parse().ok()
    };
    let mirror = number("Reflected Rays:").unwrap_or(0);
    Some(Rays { camera: number("Rays:")?.saturating_sub(mirror), mirror, shadow: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAID: &str = "Render Statistics\nImage Resolution 640 x 480\n\
        Pixels:           307200   Samples:          310000   Smpls/Pxl: 1.01\n\
        Rays:             350000   Saved:               226   Max Level: 5/6\n\
        Shadow Ray Tests:              4733   Succeeded:                  1076\n\
        Reflected Rays:                40000\n\
        Render Time:\n  Photon Time:      No photons\n\
        \x20 Trace Time:       0 hours  1 minutes  0 seconds (60.639 seconds)\n   using 2 thread(s)";

    #[test]
    fn its_statistics_are_understood() {
        assert_eq!(trace_time(SAID), Some(Duration::from_secs_f64(60.639)));
        assert_eq!(rays(SAID), Some(Rays { camera: 310_000, mirror: 40_000, shadow: None }));
        assert_eq!((trace_time("nothing"), rays("nothing")), (None, None));
    }
}
