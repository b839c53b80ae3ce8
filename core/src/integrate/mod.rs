//! Radiance along rays.

mod camera;
mod double_double;
mod refine;
mod shade;
mod texels;
mod wave;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::bvh::{Boxes, Bvh};
use crate::film::transfer::to_linear;
use crate::film::{GRID, PlanePoint};
use crate::scene::{Pigment, Scene, TextureId};
use crate::settings::{Sampling, Settings};
use crate::shapes::ObjectId;
use crate::shapes::texture::{self, Mapping};
use crate::simd::{Level, dispatch};
use crate::traverse::PreparedScene;
use crate::traverse::filter::Filter;
use camera::Frame;
use texels::Texels;
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
    /// Rays of no more weight are taken as they are.
    given: f64,
    texels: Arc<[Texels]>,
    mappings: Arc<[Mapping]>,
    /// Whether any surface mirrors.
    mirrors: bool,
    level: Level,
    refinement: Refinement,
    /// Whether f32 is asked before f64.
    filters: bool,
    /// Set when nobody wants what is rendered any more.
    unwanted: Option<Arc<AtomicBool>>,
}

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
            Sampling::Scrambled { .. } | Sampling::Adaptive => GRID,
        };
        let scene = Arc::clone(&prepared.scene);
        let linear = |c: [f64; 3]| DVec3::from_array(c.map(|x| to_linear(settings.transfer, x)));
        let materials: Arc<[Material]> = scene
            .surfaces()
            .par_iter()
            .map(|s| {
                let color = match s.pigment {
                    Pigment::Color(c) => linear(c),
                    Pigment::Texture(_) => DVec3::ONE,
                };
                Material { albedo: color * s.diffuse, reflect: s.reflect, pigment: s.pigment }
            })
            .collect::<Vec<_>>()
            .into();
        let background = linear(scene.background());
        Ok(Self {
            settings,
            grid,
            mirrors: materials.iter().any(|m| m.reflect > 0.0),
            level: Level::best(),
            refinement: Refinement::On,
            filters: true,
            unwanted: None,
            frame: Frame::new(scene.camera(), &settings.view, grid),
            materials,
            given: given(&scene, settings.max_depth, background),
            background,
            texels: scene.textures().iter().map(|p| Texels::new(p, |x| to_linear(settings.transfer, x))).collect(),
            mappings: texture::mappings(&scene, &prepared.local).into(),
            prepared,
        })
    }

    pub(crate) fn frame(&self) -> &Frame {
        &self.frame
    }

    pub(crate) fn grid(&self) -> u32 {
        self.grid
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

    /// The same tracer without packets of f32: what they leave out is nothing, which tests hold them to.
    #[doc(hidden)]
    #[must_use]
    pub fn without_filter(self) -> Self {
        Self { filters: false, ..self }
    }

    /// What packets of f32 walk through, where they can.
    fn packets(&self) -> Option<(&Filter, &Bvh<f32>)> {
        match (&self.prepared.filter, &self.prepared.boxes) {
            (Some(filter), Boxes::F32(bvh)) if self.filters => Some((filter, bvh)),
            _ => None,
        }
    }

    /// Whether a mirrored ray of this weight is taken as it is: see [`given`].
    pub(crate) fn is_given(&self, throughput: f64) -> bool {
        throughput <= self.given
    }

    /// What `id` does with light.
    pub(crate) fn material(&self, id: ObjectId) -> &Material {
        &self.materials[self.prepared.surface_of(id).0 as usize]
    }

    /// Whether `object` shows a picture.
    pub(crate) fn is_pictured(&self, object: u32) -> bool {
        matches!(self.material(ObjectId(object)).pigment, Pigment::Texture(_))
    }

    /// The colour at (u, v) of a picture that lies on `id`.
    pub(crate) fn picture_color(&self, picture: TextureId, uv: DVec2, id: ObjectId) -> DVec3 {
        let scene = &self.prepared.scene;
        let at = picture.0 as usize;
        self.texels[at].sample(&scene.textures()[at], uv, texture::wraps(scene, id))
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
}

/// The weight up to which mirrored rays are taken as they are: all that comes along them is below what values may be off
/// by. Where no surface sends out more than it takes in, no point sends more than the background or all lights together;
/// else each mirror may add all lights once more.
fn given(scene: &Scene, max_depth: u32, background: DVec3) -> f64 {
    let brightest = background.max_element().max(scene.lights().len() as f64);
    let bright = scene.surfaces().iter().any(|s| s.diffuse + s.reflect > 1.0 + 1e-9);
    let times = if bright { f64::from(max_depth) + 1.0 } else { 1.0 };
    // Rays from the camera are never taken so.
    (shade::VALUE / (brightest * times)).min(0.5)
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
