//! Radiance along rays.

pub(crate) mod arbiter;
mod camera;
mod condition;
mod coplanar;
mod court;
mod double;
mod filter;
mod giants;
mod packet;
mod path;
mod prepared;
mod proof;
mod query;
mod shade;
pub(crate) mod texture;
mod wave;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

pub use camera::PlanePoint;
pub use condition::Condition;
pub use coplanar::SharedPlanes;
pub use prepared::{PreparedScene, RayHit};

use crate::film::transfer::to_linear;
use crate::film::{ErrorEstimate, Region, Tile};
use crate::geometry::ObjectId;
use crate::geometry::local::kind;
use crate::sampling::points::{self, Sequence};
use crate::sampling::{adaptive, coarse};
use crate::scene::{PictureId, Pigment};
use crate::settings::{AuditRate, Detail, Pass, Sampling, Settings};
use crate::simd::{Level, dispatch};
use camera::Frame;
use texture::{Mapping, Texels};
use wave::Wave;
pub(crate) use wave::WaveScratch;

/// Rays traced, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// From the camera.
    pub camera: u64,
    /// Off mirrors.
    pub mirror: u64,
    /// Towards lights.
    pub shadow: u64,
    /// Decisions and values that plain f64 left open and wider numbers settled.
    pub refined: u64,
    /// Samples of which something was taken from wider numbers as they were, though their proven
    /// error left it open: paths so long and curved that they use up any number of digits.
    pub unresolved: u64,
}

/// Whether wide arithmetic decides what f64 leaves open.
///
/// For benches, to show what exactness costs: no setting, message or command reaches this.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Refinement {
    /// As the image model demands.
    #[default]
    On,
    /// What f64 leaves open goes by f64's own value. Pictures may be wrong.
    Off,
}

impl RayCounts {
    /// Rays of every kind.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.camera + self.mirror + self.shadow
    }
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, o: Self) {
        self.camera += o.camera;
        self.mirror += o.mirror;
        self.shadow += o.shadow;
        self.refined += o.refined;
        self.unresolved += o.unresolved;
    }
}

/// Why a scene cannot be traced under some settings.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PrepareError {
    /// Settings out of range.
    #[error("max-depth must be 1 to {max}", max = Settings::MAX_DEPTH)]
    MaxDepth,
}

/// What one point of the image plane shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    /// Linear, unclamped radiance.
    pub(crate) radiance: DVec3,
}

impl Sample {
    pub(crate) const BLANK: Self = Self { radiance: DVec3::ZERO };
}

/// A surface under a transfer: linear colour times diffuse, and what it mirrors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Material {
    /// Diffuse share times the linear colour; for a pictured surface the share alone.
    pub(crate) albedo: DVec3,
    reflect: f64,
    pub(crate) pigment: Pigment,
}

impl Material {
    pub(crate) fn reflect(&self) -> f64 {
        self.reflect
    }
}

/// Traces pixels of one picture: a prepared scene under fixed settings. A copy shares what is large.
#[derive(Clone, Debug)]
pub struct Tracer {
    prepared: Arc<PreparedScene>,
    settings: Settings,
    grid: u32,
    frame: Frame,
    materials: Arc<[Material]>,
    background: DVec3,
    texels: Arc<[Texels]>,
    mappings: Arc<[Mapping]>,
    /// Whether any surface mirrors.
    mirrors: bool,
    level: Level,
    refinement: Refinement,
    /// Set when nobody wants what is rendered any more.
    unwanted: Option<Arc<AtomicBool>>,
}

/// Pixels along the edge of the blocks that threads take: large ones keep more of the rays that
/// mirrors send on side by side, small ones keep more threads busy.
const BLOCK: [u32; 2] = [32, 16];

impl Tracer {
    /// A tracer of `prepared` under `settings`.
    ///
    /// # Errors
    /// When the settings are out of range.
    pub fn new(prepared: Arc<PreparedScene>, settings: Settings) -> Result<Self, PrepareError> {
        if !(1..=Settings::MAX_DEPTH).contains(&settings.max_depth) {
            return Err(PrepareError::MaxDepth);
        }
        let grid = match settings.sampling {
            Sampling::Uniform { grid } => grid,
            Sampling::Scrambled { .. } | Sampling::Adaptive => points::GRID,
        };
        let scene = Arc::clone(&prepared.scene);
        let linear = |c: [f64; 3]| DVec3::from_array(c.map(|x| to_linear(settings.transfer, x)));
        let materials: Arc<[Material]> = scene
            .surfaces()
            .par_iter()
            .map(|s| {
                let color = match s.pigment {
                    Pigment::Color(c) => linear(c),
                    Pigment::Picture(_) => DVec3::ONE,
                };
                Material { albedo: color * s.diffuse, reflect: s.reflect, pigment: s.pigment }
            })
            .collect::<Vec<_>>()
            .into();
        Ok(Self {
            settings,
            grid,
            mirrors: materials.iter().any(|m| m.reflect > 0.0),
            level: Level::best(),
            refinement: Refinement::On,
            unwanted: None,
            frame: Frame::new(scene.camera(), &settings.view, grid),
            materials,
            background: linear(scene.background()),
            texels: scene.pictures().iter().map(|p| Texels::new(p, |x| to_linear(settings.transfer, x))).collect(),
            mappings: texture::mappings(&scene, &prepared.local).into(),
            prepared,
        })
    }

    pub(crate) fn frame(&self) -> &Frame {
        &self.frame
    }

    pub(crate) fn level(&self) -> Level {
        self.level
    }

    pub(crate) fn prepared(&self) -> &PreparedScene {
        &self.prepared
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Renders the pixels of `region` by uniform sampling, in parallel on the calling rayon pool; of an adaptive
    /// picture, the coarsest there is ([`Tracer::render_pass`] gives others).
    ///
    /// # Panics
    /// When `region` reaches outside the picture.
    #[must_use]
    pub fn render(&self, region: Region) -> (Tile, RayCounts) {
        let view = &self.settings.view;
        assert!(region.x1 <= view.width() && region.y1 <= view.height(), "region outside the picture");
        if self.settings.sampling == Sampling::Adaptive {
            return coarse::render(self, region, Detail::COARSEST, AuditRate::default());
        }
        let threads = rayon::current_num_threads();
        let [large, small] = BLOCK;
        let few = region.area() < 4 * threads as u64 * u64::from(large * large);
        let blocks = region.blocks(if few && threads > 1 { small } else { large });
        let mut pixels = vec![[0.0; 3]; region.area() as usize];
        let mut counts = RayCounts::default();
        let width = region.width() as usize;
        let start = |block: &Region| (block.y0 - region.y0) as usize * width + (block.x0 - region.x0) as usize;
        if threads == 1 {
            let mut scratch = BlockScratch::default();
            for block in blocks {
                self.block(block, &mut scratch, &mut counts, &mut pixels[start(&block)..], width);
            }
            return (Tile { region, pixels, error: ErrorEstimate::default() }, counts);
        }
        let done: Vec<(Region, Vec<[f32; 3]>, RayCounts)> = blocks
            .into_par_iter()
            .map_init(BlockScratch::default, |scratch, block| {
                let mut counts = RayCounts::default();
                let mut pixels = vec![[0.0; 3]; block.area() as usize];
                self.block(block, scratch, &mut counts, &mut pixels, block.width() as usize);
                (block, pixels, counts)
            })
            .collect();
        for (block, part, c) in done {
            counts += c;
            let lines = pixels[start(&block)..].chunks_mut(width);
            for (to, line) in lines.zip(part.chunks_exact(block.width() as usize)) {
                to[..line.len()].copy_from_slice(line);
            }
        }
        (Tile { region, pixels, error: ErrorEstimate::default() }, counts)
    }

    /// Renders the pixels of `region` in one pass of an adaptive picture, and audits some of them, in parallel on
    /// the calling rayon pool. Under uniform sampling the result is that of [`Tracer::render`].
    ///
    /// # Panics
    /// When `region` reaches outside the picture.
    #[must_use]
    pub fn render_pass(&self, region: Region, pass: Pass) -> (Tile, RayCounts) {
        let view = &self.settings.view;
        assert!(region.x1 <= view.width() && region.y1 <= view.height(), "region outside the picture");
        match (self.settings.sampling, pass.detail) {
            (Sampling::Adaptive, Detail::Coarse { step }) => coarse::render(self, region, step, pass.audit),
            (Sampling::Adaptive, Detail::Within(tolerance)) => adaptive::render(self, region, tolerance, pass.audit),
            _ => self.render(region),
        }
    }

    /// The same tracer, which stops soon after `unwanted` is set. What it renders then is of no use: whoever set it
    /// knows.
    #[must_use]
    pub fn until(&self, unwanted: Arc<AtomicBool>) -> Self {
        Self { unwanted: Some(unwanted), ..self.clone() }
    }

    /// Whether nobody wants what is rendered any more.
    pub(crate) fn is_unwanted(&self) -> bool {
        self.unwanted.as_ref().is_some_and(|unwanted| unwanted.load(Ordering::Relaxed))
    }

    /// The same tracer by other instructions; every level gives the same bits.
    ///
    /// # Panics
    /// When this machine does not offer `level`.
    #[must_use]
    pub fn with_level(self, level: Level) -> Self {
        assert!(Level::all().contains(&level), "{level:?} is not offered by this machine");
        Self { level, ..self }
    }

    /// The same tracer with or without wide arithmetic. For benches alone: without it, pictures
    /// may be wrong.
    #[doc(hidden)]
    #[must_use]
    pub fn with_refinement(self, refinement: Refinement) -> Self {
        Self { refinement, ..self }
    }

    /// What `id` does with light.
    pub(crate) fn material(&self, id: ObjectId) -> &Material {
        &self.materials[self.prepared.surface_of(id).0 as usize]
    }

    /// Whether `object` shows a picture.
    pub(crate) fn is_pictured(&self, object: u32) -> bool {
        matches!(self.material(ObjectId(object)).pigment, Pigment::Picture(_))
    }

    /// The colour at (u, v) of a picture that lies on `id`.
    pub(crate) fn picture_color(&self, picture: PictureId, uv: DVec2, id: ObjectId) -> DVec3 {
        let scene = &self.prepared.scene;
        let at = picture.0 as usize;
        self.texels[at].sample(&scene.pictures()[at], uv, texture::wraps(kind(scene, id)))
    }

    /// What is seen through `points`, by rays of more weight than `least`. Sequential: callers spread
    /// work over threads. Neighbours in the list had better be neighbours in the plane.
    pub(crate) fn trace(
        &self,
        points: &[PlanePoint],
        least: f64,
        out: &mut [Sample],
        scratch: &mut WaveScratch,
        counts: &mut RayCounts,
    ) {
        for (points, out) in points.chunks(wave::PATHS).zip(out.chunks_mut(wave::PATHS)) {
            if self.is_unwanted() {
                return;
            }
            self.wave(points, least, out, scratch, counts);
        }
    }

    /// The plainest wave of at most [`wave::PATHS`] points.
    fn wave(
        &self,
        points: &[PlanePoint],
        least: f64,
        out: &mut [Sample],
        scratch: &mut WaveScratch,
        counts: &mut RayCounts,
    ) {
        dispatch(self.level, Wave { tracer: self, points, least, out, scratch, counts });
    }

    /// Renders `block` to the front of `pixels`, `stride` pixels a row.
    fn block(
        &self,
        block: Region,
        scratch: &mut BlockScratch,
        counts: &mut RayCounts,
        pixels: &mut [[f32; 3]],
        stride: usize,
    ) {
        if let Sampling::Scrambled { samples } = self.settings.sampling {
            return self.scrambled_block(block, samples, scratch, counts, pixels, stride);
        }
        let n = self.grid;
        let (width, height) = (block.width() * n, block.height() * n);
        let BlockScratch { points, samples, ordered } = scratch;
        points.clear();
        packets(width, height, |x, y| points.push(self.frame.cell(block.x0 * n + x, block.y0 * n + y)));
        samples.resize(points.len(), Sample::BLANK);
        WaveScratch::with(|wave| self.trace(points, 0.0, samples, wave, counts));
        let single = |v: DVec3| [v.x as f32, v.y as f32, v.z as f32];
        let mut done = samples.iter();
        if n == 1 {
            packets(width, height, |x, y| {
                if let Some(sample) = done.next() {
                    pixels[y as usize * stride + x as usize] = single(sample.radiance);
                }
            });
            return;
        }
        ordered.resize(points.len(), DVec3::ZERO);
        packets(width, height, |x, y| {
            if let Some(sample) = done.next() {
                ordered[(y * width + x) as usize] = sample.radiance;
            }
        });
        let share = 1.0 / f64::from(n * n);
        for j in 0..block.height() {
            for i in 0..block.width() {
                let mut sum = DVec3::ZERO;
                for b in 0..n {
                    let row = ((j * n + b) * width + i * n) as usize;
                    sum = ordered[row..row + n as usize].iter().fold(sum, |sum, &x| sum + x);
                }
                pixels[j as usize * stride + i as usize] = single(sum * share);
            }
        }
    }
}

impl Tracer {
    /// The same by so many points of each pixel's sequence.
    fn scrambled_block(
        &self,
        block: Region,
        n: u32,
        scratch: &mut BlockScratch,
        counts: &mut RayCounts,
        pixels: &mut [[f32; 3]],
        stride: usize,
    ) {
        let view = &self.settings.view;
        let BlockScratch { points, samples, .. } = scratch;
        // As many points at a time as keep packets full and memory small.
        let rows = (4096 / (block.width() * n).max(1)).clamp(1, 8) * 4;
        for strip in block.blocks(block.width().max(rows)).into_iter().flat_map(|b| strips(b, rows)) {
            points.clear();
            packets(strip.width(), strip.height(), |i, j| {
                let sequence = Sequence::new(view, (strip.x0 + i, strip.y0 + j), 0);
                points.extend((0..n).map(|k| sequence.point(k)));
            });
            samples.resize(points.len(), Sample::BLANK);
            WaveScratch::with(|wave| self.trace(points, 0.0, samples, wave, counts));
            let mut done = samples.chunks_exact(n as usize);
            packets(strip.width(), strip.height(), |i, j| {
                if let Some(of_pixel) = done.next() {
                    let sum: DVec3 = of_pixel.iter().map(|s| s.radiance).sum();
                    let at = (strip.y0 - block.y0 + j) as usize * stride + (strip.x0 - block.x0 + i) as usize;
                    pixels[at] = (sum * (1.0 / f64::from(n))).to_array().map(|c| c as f32);
                }
            });
        }
    }
}

/// `region` cut into strips of so many rows.
fn strips(region: Region, rows: u32) -> impl Iterator<Item = Region> {
    (region.y0..region.y1).step_by(rows as usize).map(move |y0| Region { y0, y1: region.y1.min(y0 + rows), ..region })
}

/// Memory of a thread that renders blocks.
#[derive(Default)]
struct BlockScratch {
    points: Vec<PlanePoint>,
    samples: Vec<Sample>,
    ordered: Vec<DVec3>,
}

/// Visits the cells of a grid so that sixteen in a row make a packet: squares of 4 × 4.
#[inline(always)]
pub(crate) fn packets(width: u32, height: u32, mut visit: impl FnMut(u32, u32)) {
    for y0 in (0..height).step_by(4) {
        for x0 in (0..width).step_by(4) {
            for y in y0..height.min(y0 + 4) {
                for x in x0..width.min(x0 + 4) {
                    visit(x, y);
                }
            }
        }
    }
}
