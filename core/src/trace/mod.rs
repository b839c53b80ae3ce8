//! Radiance along rays.

pub(crate) mod arbiter;
mod camera;
mod condition;
mod court;
mod double;
mod filter;
mod packet;
mod path;
mod prepared;
mod query;
pub(crate) mod record;
mod shade;
pub(crate) mod texture;
mod wave;

use std::sync::Arc;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

pub use camera::PlanePoint;
pub use condition::Condition;
pub use prepared::{PreparedScene, RayHit};

use crate::film::transfer::to_linear;
use crate::film::{ErrorEstimate, Region, Tile};
use crate::geometry::ObjectId;
use crate::geometry::local::kind;
use crate::sampling::small::Marks;
use crate::sampling::{adaptive, lattice};
use crate::scene::{PictureId, Pigment};
use crate::settings::{Sampling, Settings, Tolerance};
use crate::simd::{Level, dispatch};
use camera::Frame;
pub(crate) use path::{PathScratch, mix};
use record::{Look, Probe, Recording, Records};
use texture::{Mapping, Texels};
pub(crate) use wave::WaveScratch;
use wave::{Blockers, Wave};

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
    #[error("max-depth must be at least 1")]
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

/// Traces pixels of one picture: a prepared scene under fixed settings.
#[derive(Debug)]
pub struct Tracer {
    prepared: Arc<PreparedScene>,
    settings: Settings,
    grid: u32,
    frame: Frame,
    materials: Vec<Material>,
    background: DVec3,
    texels: Vec<Texels>,
    mappings: Vec<Mapping>,
    /// Whether any surface mirrors.
    mirrors: bool,
    /// What could fall between pixel corners; for adaptive sampling only.
    marks: Marks,
    level: Level,
    refinement: Refinement,
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
        if settings.max_depth == 0 {
            return Err(PrepareError::MaxDepth);
        }
        let grid = match settings.sampling {
            Sampling::Uniform { grid } => grid,
            Sampling::Adaptive { .. } => lattice::GRID,
        };
        let scene = Arc::clone(&prepared.scene);
        let linear = |c: [f64; 3]| DVec3::from_array(c.map(|x| to_linear(settings.transfer, x)));
        let materials: Vec<Material> = scene
            .surfaces()
            .par_iter()
            .map(|s| {
                let color = match s.pigment {
                    Pigment::Color(c) => linear(c),
                    Pigment::Picture(_) => DVec3::ONE,
                };
                Material { albedo: color * s.diffuse, reflect: s.reflect, pigment: s.pigment }
            })
            .collect();
        let mut tracer = Self {
            settings,
            grid,
            marks: Marks::default(),
            mirrors: materials.iter().any(|m| m.reflect > 0.0),
            level: Level::best(),
            refinement: Refinement::On,
            frame: Frame::new(scene.camera(), &settings.view, grid),
            materials,
            background: linear(scene.background()),
            texels: scene.pictures().iter().map(|p| Texels::new(p, |x| to_linear(settings.transfer, x))).collect(),
            mappings: texture::mappings(&scene, &prepared.local),
            prepared,
        };
        if let Sampling::Adaptive { .. } = settings.sampling {
            tracer.marks = Marks::new(&tracer);
        }
        Ok(tracer)
    }

    /// The lights, in local space.
    pub(crate) fn lights(&self) -> &[DVec3] {
        &self.prepared.local.lights
    }

    /// A bound on the largest component of radiance along any ray; infinite where mirrors keep everything.
    pub(crate) fn brightest(&self) -> f64 {
        let lights = self.lights().len() as f64;
        let sent = |m: &Material| m.albedo.max_element() * lights;
        let most = self.materials.iter().map(sent).fold(self.background.max_element(), f64::max);
        let reflect = self.materials.iter().map(|m| m.reflect).fold(0.0, f64::max);
        if most == 0.0 { 0.0 } else { most / (1.0 - reflect).max(0.0) }
    }

    pub(crate) fn marks(&self) -> &Marks {
        &self.marks
    }

    pub(crate) fn frame(&self) -> &Frame {
        &self.frame
    }

    pub(crate) fn prepared(&self) -> &PreparedScene {
        &self.prepared
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Renders the pixels of `region`, in parallel on the calling rayon pool.
    ///
    /// # Panics
    /// When `region` reaches outside the picture.
    #[must_use]
    pub fn render(&self, region: Region) -> (Tile, RayCounts) {
        let view = &self.settings.view;
        assert!(region.x1 <= view.width() && region.y1 <= view.height(), "region outside the picture");
        if let Sampling::Adaptive { tolerance, .. } = self.settings.sampling {
            return self.render_within(region, tolerance);
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

    /// Renders the pixels of `region` adaptively within `tolerance`, in parallel on the calling
    /// rayon pool. The settings' own tolerance does not count; under uniform sampling the
    /// result is that of [`Tracer::render`].
    ///
    /// # Panics
    /// When `region` reaches outside the picture.
    #[must_use]
    pub fn render_within(&self, region: Region, tolerance: Tolerance) -> (Tile, RayCounts) {
        let (tile, _, counts) = self.render_estimated(region, tolerance);
        (tile, counts)
    }

    /// [`Tracer::render_within`], with the standard deviation of every pixel's error as a
    /// fraction of full scale; none under uniform sampling.
    ///
    /// # Panics
    /// When `region` reaches outside the picture.
    #[must_use]
    pub fn render_estimated(&self, region: Region, tolerance: Tolerance) -> (Tile, Vec<f32>, RayCounts) {
        let view = &self.settings.view;
        assert!(region.x1 <= view.width() && region.y1 <= view.height(), "region outside the picture");
        match self.settings.sampling {
            Sampling::Adaptive { every_pixel, .. } => adaptive::render(self, region, tolerance.fraction(), every_pixel),
            Sampling::Uniform { .. } => {
                let (tile, counts) = self.render(region);
                (tile, Vec::new(), counts)
            }
        }
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

    /// Records the paths through `points`, each until its weight is below `least`. Sequential:
    /// callers spread work over threads. Neighbours in the list had better be neighbours in the
    /// plane.
    pub(crate) fn record(
        &self,
        points: &[PlanePoint],
        least: f64,
        records: &mut Records,
        scratch: &mut WaveScratch,
        counts: &mut RayCounts,
    ) {
        let mut out = [Sample::BLANK; wave::PATHS];
        for points in points.chunks(wave::PATHS) {
            let (record, out) = (Some(Recording::new(points.len(), records)), &mut out[..points.len()]);
            self.wave(points, record, least, out, scratch, counts);
            let found = dispatch(self.level, Blockers { tracer: self, dark: records.dark(), scratch });
            records.blocked_by(&found);
        }
    }

    /// Looks through `points`, at what `looks` and their `lights` say. As [`Self::record`] else.
    pub(crate) fn probe(
        &self,
        points: &[PlanePoint],
        (looks, lights): (&[Look], &[u64]),
        least: f64,
        probes: &mut [Probe],
        scratch: &mut WaveScratch,
        counts: &mut RayCounts,
    ) {
        let mut out = [Sample::BLANK; wave::PATHS];
        let words = self.lights().len().div_ceil(64);
        let each = looks.chunks(wave::PATHS).zip(probes.chunks_mut(wave::PATHS));
        for (points, (looks, probes)) in points.chunks(wave::PATHS).zip(each) {
            let record = Some(Recording::probing(looks, lights, words, probes));
            let out = &mut out[..points.len()];
            self.wave(points, record, least, out, scratch, counts);
        }
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

    /// What is seen through `points`, by rays of more weight than `least`. As [`Self::record`] else.
    pub(crate) fn trace(
        &self,
        points: &[PlanePoint],
        least: f64,
        out: &mut [Sample],
        scratch: &mut WaveScratch,
        counts: &mut RayCounts,
    ) {
        for (points, out) in points.chunks(wave::PATHS).zip(out.chunks_mut(wave::PATHS)) {
            self.wave(points, None, least, out, scratch, counts);
        }
    }

    /// The plainest wave of at most [`wave::PATHS`] points.
    fn wave(
        &self,
        points: &[PlanePoint],
        record: Option<Recording<'_>>,
        least: f64,
        out: &mut [Sample],
        scratch: &mut WaveScratch,
        counts: &mut RayCounts,
    ) {
        dispatch(self.level, Wave { tracer: self, points, record, least, out, scratch, counts });
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
