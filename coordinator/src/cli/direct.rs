//! Stands in for the farm until it renders: the tracer called directly, strip by strip.

use std::sync::Arc;
use std::time::Instant;

use coordinator::{Pixels, Progress, RenderError, RenderJob, Rendered, SceneSource, Unfinished};
use tessera_core::film::{Region, encode};
use tessera_core::trace::{PreparedScene, RayCounts, Tracer};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

pub(crate) fn render(
    job: &RenderJob,
    tell: &watch::Sender<Progress>,
    stop: &CancellationToken,
) -> Result<Rendered, Unfinished> {
    let began = Instant::now();
    let prepared = match &job.scene {
        SceneSource::Prepared(p) => Arc::clone(p),
        SceneSource::Resolved(s) => Arc::new(PreparedScene::build(Arc::clone(s))),
    };
    let tracer = Tracer::new(prepared, job.settings).map_err(RenderError::from)?;
    let (w, region) = (job.region.width() as usize, job.region);
    let mut image = Pixels::black(job.pixels, region.area() as usize);
    let (mut rays, mut done) = (RayCounts::default(), Vec::new());
    for y in (region.y0..region.y1).step_by(16) {
        if stop.is_cancelled() {
            break;
        }
        let strip = Region { y0: y, y1: (y + 16).min(region.y1), ..region };
        let (tile, counts) = tracer.render(strip);
        rays += counts;
        let at = (y - region.y0) as usize * w..(strip.y1 - region.y0) as usize * w;
        let transfer = job.settings.transfer;
        match &mut image {
            Pixels::Rgb8(p) => p[at].copy_from_slice(&encode::to_bytes(transfer, &tile.pixels)),
            Pixels::Rgb16(p) => p[at].copy_from_slice(&encode::to_words(transfer, &tile.pixels)),
            Pixels::F32(p) => p[at].copy_from_slice(&tile.pixels),
        }
        done.push(strip);
        tell.send_modify(|p| {
            p.tiles_done = done.len() as u64;
            p.tiles_total = u64::from(region.height().div_ceil(16));
            p.pixels_done = done.iter().map(Region::area).sum();
            p.pixels_total = region.area();
            p.rays = rays;
            p.elapsed = began.elapsed();
        });
    }
    let tiles = done.len() as u64;
    let rendered = Rendered { region, image, done, rays, workers: Vec::new(), tiles, trace: began.elapsed() };
    if rendered.is_complete() {
        Ok(rendered)
    } else {
        Err(Unfinished { error: RenderError::Cancelled, partial: Some(Box::new(rendered)) })
    }
}
