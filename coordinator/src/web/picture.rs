//! Pictures, whole or in part, finished or not.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;
use tessera_core::film::{Region, encode};
use tessera_core::settings::{Settings, Transfer};
use tessera_proto::control::{Job, State as JobState};
use tessera_proto::{PixelFormat, Pixels};

use super::api::{Id, id};
use super::source::Source;
use super::{Refusal, Site, refusal};
use crate::film::{Excerpt as Seen, look};
use crate::queue::region_of;

/// Edge of a picture that is made here, at most.
const MAX_EDGE: u32 = 4096;

/// Which part, and how large.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Part {
    /// `x0,y0,x1,y1`, in pixels of the picture.
    region: Option<String>,
    width: Option<u32>,
    height: Option<u32>,
}

/// Which pixel.
#[derive(Debug, Deserialize)]
pub(super) struct At {
    x: u32,
    y: u32,
}

/// What a job's picture is like.
struct Form {
    whole: Region,
    format: PixelFormat,
    transfer: Transfer,
}

impl Form {
    fn of(job: &Job) -> Option<Self> {
        let spec = job.spec.as_ref()?;
        let settings = Settings::try_from(spec.settings?).ok()?;
        let whole = region_of(spec.region.as_ref(), &settings)?;
        Some(Self { whole, format: PixelFormat::try_from(spec.pixels()).ok()?, transfer: settings.transfer })
    }
}

fn bad(why: &str) -> Refusal {
    refusal(StatusCode::BAD_REQUEST, why)
}

fn region(text: &str) -> Option<Region> {
    let numbers: Vec<u32> = text.split(',').map(|n| n.trim().parse().ok()).collect::<Option<_>>()?;
    let &[x0, y0, x1, y1] = &numbers[..] else { return None };
    Region::new(x0, y0, x1, y1)
}

/// What is seen of a job's picture, from wherever it is.
fn seen(farm: &dyn Source, job: &Job, form: &Form, region: &Region, size: (u32, u32)) -> Option<Seen> {
    if let Some(seen) = farm.canvas(job.id).and_then(|canvas| canvas.look(region, size.0, size.1)) {
        return Some(seen);
    }
    if job.state() == JobState::Done {
        let rows = rows(&farm.stored(job)?, form, region)?;
        let held = Region { x0: form.whole.x0, y0: region.y0, x1: form.whole.x1, y1: region.y1 };
        return look(&rows, &held, region, size);
    }
    let partial = farm.partial(job.id)?;
    look(&partial.image, &partial.region, region, size)
}

/// The rows of a stored picture that `region` touches.
fn rows(path: &std::path::Path, form: &Form, region: &Region) -> Option<Pixels> {
    let row = form.whole.width() as usize * form.format.bytes_per_pixel();
    let mut file = File::open(path).ok()?;
    file.seek(SeekFrom::Start(u64::from(region.y0 - form.whole.y0) * row as u64)).ok()?;
    let mut image = Pixels::black(form.format, form.whole.width() as usize * region.height() as usize)?;
    let mut bytes = vec![0; row];
    for n in 0..region.height() as usize {
        file.read_exact(&mut bytes).ok()?;
        image.put(n * form.whole.width() as usize, &bytes);
    }
    Some(image)
}

fn codes(seen: Seen, transfer: Transfer) -> Vec<[u8; 3]> {
    match seen {
        Seen::Codes(codes) => codes,
        Seen::Linear(pixels) => encode::to_bytes(transfer, &pixels),
    }
}

pub(super) async fn png(
    State(site): State<Site>,
    named: Id,
    part: Result<Query<Part>, QueryRejection>,
) -> Result<Response, Refusal> {
    let job = site.farm.job(id(named)?)?;
    let Ok(Query(part)) = part else { return Err(bad("width and height are numbers")) };
    let form = Form::of(&job).ok_or_else(|| bad("the job has no picture"))?;
    let region = match &part.region {
        None => form.whole,
        Some(text) => region(text).ok_or_else(|| bad("a region is X0,Y0,X1,Y1"))?,
    };
    if !form.whole.contains(&region) {
        return Err(bad("the region reaches outside the picture"));
    }
    let width = part.width.unwrap_or(region.width()).clamp(1, MAX_EDGE);
    let even = (u64::from(width) * u64::from(region.height())).div_ceil(u64::from(region.width())) as u32;
    let height = part.height.unwrap_or(even).clamp(1, MAX_EDGE);
    let _permit = site.pictures.acquire().await.map_err(|_| refusal(StatusCode::SERVICE_UNAVAILABLE, "closing"))?;
    let farm = site.farm.clone();
    let made = tokio::task::spawn_blocking(move || {
        let seen = seen(&*farm, &job, &form, &region, (width, height))?;
        let codes = codes(seen, form.transfer);
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header().ok()?;
        writer.write_image_data(codes.as_flattened()).ok()?;
        writer.finish().ok()?;
        Some(file)
    });
    match made.await {
        Ok(Some(file)) => Ok(([(CONTENT_TYPE, "image/png")], file).into_response()),
        Ok(None) => Err(refusal(StatusCode::NOT_FOUND, "there is nothing of this picture yet")),
        Err(e) => Err(refusal(StatusCode::INTERNAL_SERVER_ERROR, e)),
    }
}

pub(super) async fn pixel(
    State(site): State<Site>,
    named: Id,
    at: Result<Query<At>, QueryRejection>,
) -> Result<Response, Refusal> {
    let job = site.farm.job(id(named)?)?;
    let Ok(Query(At { x, y })) = at else { return Err(bad("x and y are numbers")) };
    let form = Form::of(&job).ok_or_else(|| bad("the job has no picture"))?;
    let one = Region::new(x, y, x.saturating_add(1), y.saturating_add(1)).filter(|r| form.whole.contains(r));
    let one = one.ok_or_else(|| bad("the pixel is outside the picture"))?;
    let farm = site.farm.clone();
    let found = tokio::task::spawn_blocking(move || {
        let seen = seen(&*farm, &job, &form, &one, (1, 1))?;
        let linear = if let Seen::Linear(pixels) = &seen { pixels.first().copied() } else { None };
        Some((linear, codes(seen, form.transfer).first().copied()))
    });
    match found.await {
        Ok(Some((linear, encoded))) => {
            Ok(axum::Json(json!({ "x": x, "y": y, "linear": linear, "encoded": encoded })).into_response())
        }
        Ok(None) => Err(refusal(StatusCode::NOT_FOUND, "there is nothing of this picture yet")),
        Err(e) => Err(refusal(StatusCode::INTERNAL_SERVER_ERROR, e)),
    }
}
