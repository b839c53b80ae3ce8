//! What the parts of pictures cost, as renders were measured: files of `tests/costs`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use coordinator::simulation::CostMap;
use tessera_core::film::Region;
use tessera_core::trace::{PreparedScene, Tracer};

use crate::generate::Document;
use crate::subject::settings;

/// Edge in pixels of the squares that are measured.
const EDGE: u32 = 16;
/// Each square counts as the quickest of so many renders: what else the machine does only adds.
const TIMES: u32 = 5;

/// The file that tells what a scene's parts cost.
#[must_use]
pub fn file(scene: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("costs").join(format!("{scene}.txt"))
}

/// What a scene's parts cost, as it was measured.
///
/// # Errors
/// When the file is not there, or is none of [`measure`]'s.
pub fn read(scene: &str) -> Result<CostMap, String> {
    let path = file(scene);
    let problem = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let text = std::fs::read_to_string(&path).map_err(|e| problem(&e))?;
    let rows: Vec<Vec<f64>> = text
        .lines()
        .map(|line| line.split_ascii_whitespace().map(str::parse).collect())
        .collect::<Result<_, std::num::ParseFloatError>>()
        .map_err(|e| problem(&e))?;
    let columns = rows.first().map_or(0, Vec::len);
    let costs = rows.concat();
    CostMap::new(columns, &costs)
        .filter(|_| rows.iter().all(|r| r.len() == columns))
        .ok_or_else(|| problem(&"no rows of costs"))
}

/// Renders a scene of `width` × `height` pixels on one thread, square by square of 16 pixels, and gives nanoseconds a
/// pixel, a row of squares a line.
///
/// # Errors
/// When the scene is none, or no thread is to be had.
pub fn measure(document: &Document, (width, height): (u32, u32)) -> Result<String, String> {
    let scene = document.scene().map_err(|e| e.to_string())?;
    let prepared = Arc::new(PreparedScene::build(Arc::new(scene)));
    let tracer = Tracer::new(prepared, settings(width, height)).map_err(|e| e.to_string())?;
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| e.to_string())?;
    let mut text = String::new();
    for y in (0..height / EDGE * EDGE).step_by(EDGE as usize) {
        let row: Vec<String> = (0..width / EDGE * EDGE)
            .step_by(EDGE as usize)
            .map(|x| {
                let region = Region { x0: x, y0: y, x1: x + EDGE, y1: y + EDGE };
                let time = alone.install(|| (0..TIMES).map(|_| time(&tracer, region)).min());
                let ns = time.unwrap_or_default().as_nanos() as u64 / region.area();
                ns.max(1).to_string()
            })
            .collect();
        text.push_str(&row.join(" "));
        text.push('\n');
    }
    Ok(text)
}

fn time(tracer: &Tracer, region: Region) -> Duration {
    let began = Instant::now();
    std::hint::black_box(tracer.render(region));
    began.elapsed()
}
