//! Scanned meshes, as text PLY packed by gzip.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use glam::dvec3;

use super::Mesh;

/// Where scanned meshes may lie: `TESSERA_MESHES`, or beside the checkout.
#[must_use]
pub fn scans() -> PathBuf {
    std::env::var_os("TESSERA_MESHES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from)
}

/// Reads a mesh by the system's gzip; `None` where there is no such file or it is not one.
#[must_use]
pub fn read_ply(path: &Path) -> Option<Mesh> {
    if !path.exists() {
        return None;
    }
    let mut text = String::new();
    let mut child = Command::new("gzip").arg("-dc").arg(path).stdout(Stdio::piped()).spawn().ok()?;
    child.stdout.take()?.read_to_string(&mut text).ok()?;
    child.wait().ok()?;
    let (head, body) = text.split_once("end_header\n")?;
    let count = |what: &str| head.lines().find_map(|l| l.strip_prefix(what)?.trim().parse::<usize>().ok());
    let (vertices, faces) = (count("element vertex")?, count("element face")?);
    let mut lines = body.lines();
    let vertices = lines
        .by_ref()
        .take(vertices)
        .map(|l| {
            let mut n = l.split_whitespace().map(str::parse::<f64>);
            let mut next = || n.next()?.ok();
            Some(dvec3(next()?, next()?, next()?))
        })
        .collect::<Option<Vec<_>>>()?;
    let faces = lines
        .take(faces)
        .map(|l| {
            let mut n = l.split_whitespace().skip(1).map(str::parse::<usize>);
            let mut next = || n.next()?.ok();
            Some([next()?, next()?, next()?])
        })
        .collect::<Option<Vec<_>>>()?;
    Some(Mesh { vertices, faces })
}
