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
mod shade;
mod texture;
mod wave;

use std::sync::Arc;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

pub use camera::PlanePoint;
pub use condition::Condition;
pub use prepared::{PreparedScene, RayHit};

use crate::film::transfer::to_linear;
use crate::film::{Region, Tile};
use crate::geometry::ObjectId;
use crate::geometry::local::kind;
use crate::scene::{PictureId, Pigment};
use crate::settings::{Sampling, Settings};
use crate::simd::{Level, dispatch};
use camera::Frame;
use texture::{Mapping, Texels};
use wave::{Wave, WaveScratch};

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
pub struct Sample {
    /// Linear, unclamped radiance.
    pub radiance: DVec3,
    /// A hash of everything discrete along the path: objects met, sides struck, lights seen.
    /// Between two points of equal signature, radiance varies smoothly or a feature lies hidden.
    pub signature: u64,
}

/// A surface under a transfer: linear colour times diffuse, and what it mirrors.
#[derive(Clone, Copy, Debug)]
struct Material {
    /// Diffuse share times the linear colour; for a pictured surface the share alone.
    albedo: DVec3,
    reflect: f64,
    pigment: Pigment,
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
    level: Level,
    refinement: Refinement,
}

/// Pixels along the edge of the blocks that threads take.
const BLOCK: u32 = 16;

impl Tracer {
    /// A tracer of `prepared` under `settings`.
    ///
    /// # Errors
    /// When the settings are out of range.
    pub fn new(prepared: Arc<PreparedScene>, settings: Settings) -> Result<Self, PrepareError> {
        if settings.max_depth == 0 {
            return Err(PrepareError::MaxDepth);
        }
        let Sampling::Uniform { grid } = settings.sampling;
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
        Ok(Self {
            settings,
            grid,
            mirrors: materials.iter().any(|m| m.reflect > 0.0),
            level: Level::best(),
            refinement: Refinement::On,
            frame: Frame::new(scene.camera(), &settings.view, grid),
            materials,
            background: linear(scene.background()),
            texels: scene.pictures().iter().map(|p| Texels::new(p, |x| to_linear(settings.transfer, x))).collect(),
            mappings: texture::mappings(&scene, &prepared.local),
            prepared,
        })
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
        let blocks = region.blocks(BLOCK);
        let done: Vec<(Region, Vec<[f32; 3]>, RayCounts)> = blocks
            .into_par_iter()
            .map_init(BlockScratch::default, |scratch, block| {
                let mut counts = RayCounts::default();
                let pixels = self.block(block, scratch, &mut counts);
                (block, pixels, counts)
            })
            .collect();
        let mut pixels = vec![[0.0; 3]; region.area() as usize];
        let mut counts = RayCounts::default();
        for (block, part, c) in done {
            counts += c;
            let width = block.width() as usize;
            for (row, line) in part.chunks_exact(width).enumerate() {
                let y = (block.y0 - region.y0) as usize + row;
                let start = y * region.width() as usize + (block.x0 - region.x0) as usize;
                pixels[start..start + width].copy_from_slice(line);
            }
        }
        (Tile { region, pixels }, counts)
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

    /// What each of `points` shows, in their order; units are 1/(2·grid) pixel of the settings' sampling.
    /// Sequential: callers spread work over threads. Neighbours in the list had better be
    /// neighbours in the plane.
    #[must_use]
    pub fn samples(&self, points: &[PlanePoint]) -> (Vec<Sample>, RayCounts) {
        let (mut scratch, mut counts) = (WaveScratch::default(), RayCounts::default());
        let mut out = vec![Sample { radiance: DVec3::ZERO, signature: 0 }; points.len()];
        self.trace(points, true, &mut out, &mut scratch, &mut counts);
        (out, counts)
    }

    /// What `id` does with light.
    fn material(&self, id: ObjectId) -> &Material {
        &self.materials[self.prepared.surface_of(id).0 as usize]
    }

    /// The colour at (u, v) of a picture that lies on `id`.
    fn picture_color(&self, picture: PictureId, uv: DVec2, id: ObjectId) -> DVec3 {
        let scene = &self.prepared.scene;
        let at = picture.0 as usize;
        self.texels[at].sample(&scene.pictures()[at], uv, texture::wraps(kind(scene, id)))
    }

    fn trace(
        &self,
        points: &[PlanePoint],
        signatures: bool,
        out: &mut [Sample],
        scratch: &mut WaveScratch,
        counts: &mut RayCounts,
    ) {
        for (points, out) in points.chunks(wave::PATHS).zip(out.chunks_mut(wave::PATHS)) {
            let wave = Wave { tracer: self, points, signatures, out, scratch: &mut *scratch, counts: &mut *counts };
            dispatch(self.level, wave);
        }
    }

    fn block(&self, block: Region, scratch: &mut BlockScratch, counts: &mut RayCounts) -> Vec<[f32; 3]> {
        let n = self.grid;
        let (width, height) = (block.width() * n, block.height() * n);
        let BlockScratch { points, samples, ordered, wave } = scratch;
        points.clear();
        packets(width, height, |x, y| points.push(self.frame.cell(block.x0 * n + x, block.y0 * n + y)));
        samples.clear();
        samples.resize(points.len(), Sample { radiance: DVec3::ZERO, signature: 0 });
        self.trace(points, false, samples, wave, counts);
        ordered.resize(points.len(), DVec3::ZERO);
        let mut done = samples.iter();
        packets(width, height, |x, y| {
            if let Some(sample) = done.next() {
                ordered[(y * width + x) as usize] = sample.radiance;
            }
        });
        let single = |v: DVec3| [v.x as f32, v.y as f32, v.z as f32];
        if n == 1 {
            return ordered.iter().map(|&v| single(v)).collect();
        }
        let share = 1.0 / f64::from(n * n);
        let mut pixels = Vec::with_capacity(block.area() as usize);
        for j in 0..block.height() {
            for i in 0..block.width() {
                let mut sum = DVec3::ZERO;
                for b in 0..n {
                    let row = ((j * n + b) * width + i * n) as usize;
                    sum = ordered[row..row + n as usize].iter().fold(sum, |sum, &x| sum + x);
                }
                pixels.push(single(sum * share));
            }
        }
        pixels
    }
}

/// Memory of a thread that renders blocks.
#[derive(Default)]
struct BlockScratch {
    points: Vec<PlanePoint>,
    samples: Vec<Sample>,
    ordered: Vec<DVec3>,
    wave: WaveScratch,
}

/// Visits the cells of a grid so that sixteen in a row make a packet: squares of 4 × 4.
#[inline(always)]
fn packets(width: u32, height: u32, mut visit: impl FnMut(u32, u32)) {
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
