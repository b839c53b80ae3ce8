//! POV-Ray, where it is installed, as an independent judge of pictures.

use std::io;
use std::path::Path;
use std::process::{Command, Stdio};

use tessera_core::scene::Scene;
use tessera_core::settings::Settings;

use crate::compare::Image;

/// Whether a `povray` answers.
#[must_use]
pub fn povray_installed() -> bool {
    Command::new("povray").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

/// Renders the scene by POV-Ray, one sample a pixel, linear, in the empty folder given.
///
/// # Errors
/// When POV-Ray cannot be run, fails, or writes no picture.
pub fn povray(scene: &Scene, settings: &Settings, folder: &Path) -> io::Result<Image> {
    coordinator::povray::export(scene, settings, folder, "scene")?;
    let out = Command::new("povray")
        .args(["+Iscene.pov", "+Oscene-out.ppm", "+FP16", "-D", "-A", "-V", "File_Gamma=1.0"])
        .arg(format!("+W{}", settings.view.width()))
        .arg(format!("+H{}", settings.view.height()))
        .current_dir(folder)
        .output()?;
    if !out.status.success() {
        return Err(io::Error::other(String::from_utf8_lossy(&out.stderr).into_owned()));
    }
    read_ppm(&std::fs::read(folder.join("scene-out.ppm"))?)
}

/// Reads a binary pixmap as fractions of its largest value.
fn read_ppm(bytes: &[u8]) -> io::Result<Image> {
    let bad = || io::Error::other("not a binary pixmap");
    let mut at = 0;
    let mut tokens = Vec::new();
    while tokens.len() < 4 {
        while bytes.get(at).ok_or_else(bad)?.is_ascii_whitespace() {
            at += 1;
        }
        let start = at;
        if bytes[at] == b'#' {
            while *bytes.get(at).ok_or_else(bad)? != b'\n' {
                at += 1;
            }
            continue;
        }
        while !bytes.get(at).ok_or_else(bad)?.is_ascii_whitespace() {
            at += 1;
        }
        tokens.push(String::from_utf8_lossy(&bytes[start..at]).into_owned());
    }
    let data = &bytes[at + 1..];
    let number = |i: usize| tokens[i].parse::<usize>().map_err(io::Error::other);
    let (width, height, max) = (number(1)?, number(2)?, number(3)?);
    let size = if max > 255 { 2 } else { 1 };
    if tokens[0] != "P6" || data.len() < width * height * 3 * size {
        return Err(bad());
    }
    let value = |i: usize| {
        let raw = if size == 2 { u32::from(data[2 * i]) << 8 | u32::from(data[2 * i + 1]) } else { data[i].into() };
        f64::from(raw) / max as f64
    };
    let pixels = (0..width * height).map(|p| [value(3 * p), value(3 * p + 1), value(3 * p + 2)]).collect();
    Ok(Image { width, height, pixels })
}
