//! Wire messages into core types and back. Whatever comes from a peer passes here.

use std::time::Duration;

use bytes::Bytes;
use tessera_core::film::{ErrorEstimate, PixelsRef, Region, Sum};
use tessera_core::settings::{AuditRate, Detail, Pass, Sampling, Settings, SettingsError, Tolerance, Transfer, View};
use tessera_core::trace::RayCounts;

use crate::identity::WorkerId;
use crate::ids::{Attempt, JobNumber, LeaseId, PassNumber, SceneHash};
use crate::limits::{
    BUILD, MAX_CAUSE_BYTES, MAX_NAME_BYTES, MAX_SCENE_BYTES, MAX_THREADS, MAX_TILE_PIXELS, NUMERIC_MODE, PROTOCOL, cut,
};
use crate::packed::unpack;
use crate::pixels::PixelFormat;
use crate::token::Secret;
use crate::wire;

/// Why a peer's message is not taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Malformed {
    /// A part that must be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A value outside what the specification allows.
    #[error("{0} is out of range")]
    Range(&'static str),
    /// Settings that no picture can have.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// More or fewer bytes than the region's pixels take.
    #[error("{got} bytes of pixels where {wanted} belong")]
    PixelBytes {
        /// Bytes that came.
        got: usize,
        /// Bytes of the region in the job's format.
        wanted: usize,
    },
    /// A pixel that is not a number.
    #[error("a pixel is not finite")]
    NotFinite,
}

/// Why two programs cannot work on one picture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Mismatch {
    /// Another protocol.
    #[error("the worker speaks protocol {0}, the coordinator {PROTOCOL}: use the same release of both")]
    Protocol(u32),
    /// Another version of the program.
    #[error("the worker is of build {0:?}, the coordinator of {BUILD:?}: use the same release of both")]
    Build(String),
    /// Other arithmetic.
    #[error("the worker computes in mode {0:?}, the coordinator in {NUMERIC_MODE:?}: pixels would differ")]
    NumericMode(String),
}

/// A worker's first words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Registration {
    /// For people; printable, not empty.
    pub name: String,
    /// 1 to [`MAX_THREADS`].
    pub threads: u32,
    /// Which worker this is.
    pub id: WorkerId,
    /// That it is this worker.
    pub proof: Vec<u8>,
    /// The secret of workers in the coordinator's own process.
    pub local: Option<Secret>,
}

impl From<Registration> for wire::Register {
    fn from(r: Registration) -> Self {
        Self {
            protocol: PROTOCOL,
            build: BUILD.into(),
            numeric_mode: NUMERIC_MODE.into(),
            threads: r.threads,
            name: cut(&r.name, MAX_NAME_BYTES).into(),
            local: r.local.map_or_else(Vec::new, |secret| secret.bytes().to_vec()),
            key: r.id.0.to_vec(),
            proof: r.proof,
        }
    }
}

/// Whether a worker fits this program.
///
/// # Errors
/// The first mismatch.
pub fn check_match(r: &wire::Register) -> Result<(), Mismatch> {
    if r.protocol != PROTOCOL {
        return Err(Mismatch::Protocol(r.protocol));
    }
    if r.build != BUILD {
        return Err(Mismatch::Build(cut(&r.build, MAX_NAME_BYTES).into()));
    }
    if r.numeric_mode != NUMERIC_MODE {
        return Err(Mismatch::NumericMode(cut(&r.numeric_mode, MAX_NAME_BYTES).into()));
    }
    Ok(())
}

impl TryFrom<wire::Register> for Registration {
    type Error = Malformed;

    fn try_from(r: wire::Register) -> Result<Self, Malformed> {
        if !(1..=MAX_THREADS).contains(&r.threads) {
            return Err(Malformed::Range("the number of threads"));
        }
        if r.name.len() > MAX_NAME_BYTES {
            return Err(Malformed::Range("the length of the name"));
        }
        // What is shown in place of what cannot be may be longer.
        let name = printable(&r.name);
        let name = cut(&name, MAX_NAME_BYTES);
        Ok(Self {
            name: if name.is_empty() { "worker".into() } else { name.into() },
            threads: r.threads,
            id: WorkerId(r.key.try_into().map_err(|_| Malformed::Range("the worker's key"))?),
            proof: r.proof,
            local: if r.local.is_empty() {
                None
            } else {
                Some(Secret::from(<[u8; 16]>::try_from(r.local).map_err(|_| Malformed::Range("the local secret"))?))
            },
        })
    }
}

/// `text` without what could disturb a terminal.
#[must_use]
pub fn printable(text: &str) -> String {
    tessera_core::text::printable(text, false).trim().into()
}

/// A peer's cause of failure, fit to be shown.
#[must_use]
pub fn cause(text: &str) -> String {
    printable(cut(text, MAX_CAUSE_BYTES))
}

/// What a worker renders until another one comes.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Which job.
    pub number: JobNumber,
    /// The scene's hash and length, or `None` where the worker was given the scene.
    pub scene: Option<(SceneHash, u64)>,
    /// How it is seen.
    pub settings: Settings,
    /// What pixels the output needs.
    pub pixels: PixelFormat,
}

impl From<Job> for wire::Job {
    fn from(job: Job) -> Self {
        let (hash, scene_bytes) = job.scene.map_or((Vec::new(), 0), |(hash, n)| (hash.0.to_vec(), n));
        Self {
            scene_sha256: hash,
            scene_bytes,
            settings: Some(job.settings.into()),
            pixels: wire::PixelFormat::from(job.pixels).into(),
            job: job.number.0,
            traceparent: String::new(),
        }
    }
}

impl TryFrom<wire::Job> for Job {
    type Error = Malformed;

    fn try_from(job: wire::Job) -> Result<Self, Malformed> {
        let pixels = job.pixels().try_into()?;
        if job.job >= JobNumber::END {
            return Err(Malformed::Range("the job's number"));
        }
        let scene = if job.scene_sha256.is_empty() {
            None
        } else {
            let hash = job.scene_sha256.try_into().map_err(|_| Malformed::Range("the scene's hash"))?;
            if job.scene_bytes > MAX_SCENE_BYTES {
                return Err(Malformed::Range("the scene's length"));
            }
            Some((SceneHash(hash), job.scene_bytes))
        };
        let settings = job.settings.ok_or(Malformed::Missing("settings"))?.try_into()?;
        Ok(Self { number: JobNumber(job.job), scene, settings, pixels })
    }
}

impl From<Settings> for wire::Settings {
    fn from(s: Settings) -> Self {
        use wire::settings::Sampling as Wire;
        Self {
            width: s.view.width(),
            height: s.view.height(),
            zoom: s.view.zoom(),
            plane_height: s.view.plane_height(),
            max_depth: s.max_depth,
            sampling: Some(match s.sampling {
                Sampling::Uniform { grid } => Wire::Grid(grid),
                Sampling::Scrambled { samples } => Wire::Scrambled(samples),
                Sampling::Adaptive => Wire::Adaptive(wire::Adaptive {}),
            }),
            transfer: match s.transfer {
                Transfer::Srgb => wire::Transfer::Srgb,
                Transfer::Linear => wire::Transfer::Linear,
            }
            .into(),
        }
    }
}

impl TryFrom<wire::Settings> for Settings {
    type Error = Malformed;

    fn try_from(s: wire::Settings) -> Result<Self, Malformed> {
        let transfer = match s.transfer() {
            wire::Transfer::Srgb => Transfer::Srgb,
            wire::Transfer::Linear => Transfer::Linear,
            wire::Transfer::Unspecified => return Err(Malformed::Range("transfer")),
        };
        if !(1..=Settings::MAX_DEPTH).contains(&s.max_depth) {
            return Err(SettingsError::MaxDepth.into());
        }
        use wire::settings::Sampling as Wire;
        let sampling = match s.sampling.ok_or(Malformed::Missing("the sampling"))? {
            Wire::Grid(grid @ 1..=Sampling::MAX_GRID) => Sampling::Uniform { grid },
            Wire::Scrambled(samples @ 1..=Sampling::MAX_SAMPLES) => Sampling::Scrambled { samples },
            Wire::Adaptive(wire::Adaptive {}) => Sampling::Adaptive,
            Wire::Grid(_) | Wire::Scrambled(_) => return Err(Malformed::Range("the number of samples")),
        };
        Ok(Self {
            view: View::new(s.width, s.height, s.zoom, s.plane_height)?,
            max_depth: s.max_depth,
            sampling,
            transfer,
        })
    }
}

fn detail(detail: wire::lease::Detail) -> Result<Detail, Malformed> {
    use wire::lease::Detail as Wire;
    match detail {
        Wire::CoarseStep(step @ 2..=Detail::COARSEST) => Ok(Detail::Coarse { step }),
        Wire::CoarseStep(_) => Err(Malformed::Range("a coarse step")),
        Wire::ToleranceBillionths(n) => tolerance(n).map(Detail::Within),
        Wire::GlanceBillionths(n) => tolerance(n).map(Detail::Glance),
    }
}

fn tolerance(billionths: u32) -> Result<Tolerance, Malformed> {
    let tolerance = Tolerance::from_billionths(billionths);
    if tolerance.billionths() == billionths { Ok(tolerance) } else { Err(Malformed::Range("a tolerance")) }
}

impl From<PixelFormat> for wire::PixelFormat {
    fn from(f: PixelFormat) -> Self {
        match f {
            PixelFormat::Rgb8 => Self::Rgb8,
            PixelFormat::Rgb16 => Self::Rgb16,
            PixelFormat::F32 => Self::F32,
        }
    }
}

impl TryFrom<wire::PixelFormat> for PixelFormat {
    type Error = Malformed;

    fn try_from(f: wire::PixelFormat) -> Result<Self, Malformed> {
        Ok(match f {
            wire::PixelFormat::Rgb8 => Self::Rgb8,
            wire::PixelFormat::Rgb16 => Self::Rgb16,
            wire::PixelFormat::F32 => Self::F32,
            wire::PixelFormat::Unspecified => return Err(Malformed::Range("the pixel format")),
        })
    }
}

impl From<Region> for wire::Region {
    fn from(r: Region) -> Self {
        Self { x0: r.x0, y0: r.y0, x1: r.x1, y1: r.y1 }
    }
}

impl TryFrom<wire::Region> for Region {
    type Error = Malformed;

    fn try_from(r: wire::Region) -> Result<Self, Malformed> {
        Self::new(r.x0, r.y0, r.x1, r.y1).filter(|r| r.area() <= MAX_TILE_PIXELS).ok_or(Malformed::Range("a region"))
    }
}

/// The right to render a region once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lease {
    /// Which lease.
    pub id: LeaseId,
    /// Which attempt at the region.
    pub attempt: Attempt,
    /// The pixels.
    pub region: Region,
    /// Which pass over the picture it belongs to.
    pub number: PassNumber,
    /// How closely that looks; `None` where sampling is uniform.
    pub pass: Option<Pass>,
}

impl From<Lease> for wire::Lease {
    fn from(l: Lease) -> Self {
        use wire::lease::Detail as Wire;
        Self {
            lease: l.id.0,
            attempt: l.attempt.0,
            region: Some(l.region.into()),
            pass: l.number.0,
            detail: l.pass.map(|pass| match pass.detail {
                Detail::Coarse { step } => Wire::CoarseStep(step),
                Detail::Within(tolerance) => Wire::ToleranceBillionths(tolerance.billionths()),
                Detail::Glance(tolerance) => Wire::GlanceBillionths(tolerance.billionths()),
            }),
            audit_rate: l.pass.map_or(0, |pass| pass.audit.0),
            pack: false,
            span: 0,
        }
    }
}

impl TryFrom<wire::Lease> for Lease {
    type Error = Malformed;

    fn try_from(l: wire::Lease) -> Result<Self, Malformed> {
        let audit = AuditRate(l.audit_rate);
        let pass = match l.detail {
            Some(d) => Some(Pass { detail: detail(d)?, audit }),
            None if audit == AuditRate::default() => None,
            None => return Err(Malformed::Missing("what to audit")),
        };
        Ok(Self {
            id: LeaseId(l.lease),
            attempt: Attempt(l.attempt),
            region: l.region.ok_or(Malformed::Missing("a region"))?.try_into()?,
            number: PassNumber(l.pass),
            pass,
        })
    }
}

impl From<RayCounts> for wire::RayCounts {
    fn from(r: RayCounts) -> Self {
        Self { camera: r.camera, mirror: r.mirror, shadow: r.shadow, refined: r.refined, unresolved: r.unresolved }
    }
}

/// Rays that one message may claim: far above what a tile can take, far below what overflows sums.
const MAX_RAYS: u64 = 1 << 48;

impl TryFrom<wire::RayCounts> for RayCounts {
    type Error = Malformed;

    fn try_from(r: wire::RayCounts) -> Result<Self, Malformed> {
        if [r.camera, r.mirror, r.shadow, r.refined, r.unresolved].iter().any(|&n| n > MAX_RAYS) {
            return Err(Malformed::Range("a number of rays"));
        }
        let wire::RayCounts { camera, mirror, shadow, refined, unresolved } = r;
        Ok(Self { camera, mirror, shadow, refined, unresolved })
    }
}

impl From<ErrorEstimate> for wire::ErrorEstimate {
    fn from(e: ErrorEstimate) -> Self {
        // `as` takes the upper and the lower half.
        let sum = |Sum(units)| (units != 0).then_some(wire::Sum { high: (units >> 64) as i64, low: units as u64 });
        let ErrorEstimate { pixels, expected, audited, squares, variance } = e;
        Self { pixels, expected: sum(expected), audited, squares: sum(squares), variance: sum(variance) }
    }
}

impl TryFrom<wire::ErrorEstimate> for ErrorEstimate {
    type Error = Malformed;

    fn try_from(e: wire::ErrorEstimate) -> Result<Self, Malformed> {
        let sum = |s: Option<wire::Sum>| Sum(s.map_or(0, |s| (i128::from(s.high) << 64) | i128::from(s.low)));
        let wire::ErrorEstimate { pixels, audited, .. } = e;
        let (expected, squares, variance) = (sum(e.expected), sum(e.squares), sum(e.variance));
        let negative = expected.0 < 0 || variance.0 < 0;
        let unfounded = audited == 0 && (squares, variance) != (Sum::default(), Sum::default());
        // Counts so small add up without overflow; sums stop at the ends of their range.
        if pixels > MAX_TILE_PIXELS || audited > pixels || negative || unfounded {
            return Err(Malformed::Range("an error"));
        }
        Ok(Self { pixels, expected, audited, squares, variance })
    }
}

/// A worker's delivery, whose pixels are not yet held against its lease.
#[derive(Clone, Debug, PartialEq)]
pub struct TileDone {
    /// The lease it answers.
    pub lease: LeaseId,
    /// The attempt it repeats.
    pub attempt: Attempt,
    /// As they came.
    pub pixels: Bytes,
    /// Their estimated errors.
    pub error: ErrorEstimate,
    /// Rays of it.
    pub rays: RayCounts,
    /// Time spent on it.
    pub busy: Duration,
    /// Time spent waiting for it.
    pub idle: Duration,
}

/// Longest time that one message may claim.
const MAX_MICROS: u64 = 1 << 42;

impl TryFrom<wire::TileDone> for TileDone {
    type Error = Malformed;

    fn try_from(t: wire::TileDone) -> Result<Self, Malformed> {
        if t.busy_us > MAX_MICROS || t.idle_us > MAX_MICROS {
            return Err(Malformed::Range("a duration"));
        }
        Ok(Self {
            lease: LeaseId(t.lease),
            attempt: Attempt(t.attempt),
            pixels: match t.packed {
                0 => t.pixels,
                bytes_per_pixel => unpack(&t.pixels, bytes_per_pixel as usize)?,
            },
            error: t.error.map_or(Ok(ErrorEstimate::default()), TryInto::try_into)?,
            rays: t.rays.ok_or(Malformed::Missing("the rays"))?.try_into()?,
            busy: Duration::from_micros(t.busy_us),
            idle: Duration::from_micros(t.idle_us),
        })
    }
}

impl From<TileDone> for wire::TileDone {
    fn from(t: TileDone) -> Self {
        let micros = |d: Duration| u64::try_from(d.as_micros()).unwrap_or(MAX_MICROS).min(MAX_MICROS);
        Self {
            lease: t.lease.0,
            attempt: t.attempt.0,
            pixels: t.pixels,
            error: (t.error.pixels > 0).then(|| t.error.into()),
            rays: Some(t.rays.into()),
            busy_us: micros(t.busy),
            idle_us: micros(t.idle),
            packed: 0,
        }
    }
}

/// Pixels as bytes of their format.
#[must_use]
pub fn pixel_bytes<'a>(pixels: impl Into<PixelsRef<'a>>) -> Bytes {
    match pixels.into() {
        PixelsRef::Rgb8(p) => Bytes::copy_from_slice(p.as_flattened()),
        PixelsRef::Rgb16(p) => p.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>().into(),
        PixelsRef::F32(p) => p.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>().into(),
    }
}

/// Whether `bytes` may be pixels of `format` at all: a whole number of them, not too many, and
/// every float finite. Whether they fit their lease is for whoever knows the lease.
///
/// # Errors
/// When they may not.
pub fn check_pixels(bytes: &[u8], format: PixelFormat) -> Result<(), Malformed> {
    let one = format.bytes_per_pixel();
    if bytes.is_empty() || !bytes.len().is_multiple_of(one) || (bytes.len() / one) as u64 > MAX_TILE_PIXELS {
        return Err(Malformed::Range("the number of pixels"));
    }
    let finite = |b: &[u8; 4]| f32::from_le_bytes(*b).is_finite();
    // Without an early end, so that the loop is a vector one.
    if format == PixelFormat::F32 && !bytes.as_chunks::<4>().0.iter().fold(true, |all, b| all & finite(b)) {
        return Err(Malformed::NotFinite);
    }
    Ok(())
}

/// Whether `bytes` are as many pixels of `format` as `region` has.
///
/// # Errors
/// When they are not.
pub fn check_size(bytes: &[u8], format: PixelFormat, region: &Region) -> Result<(), Malformed> {
    let wanted = region.area() as usize * format.bytes_per_pixel();
    if bytes.len() == wanted { Ok(()) } else { Err(Malformed::PixelBytes { got: bytes.len(), wanted }) }
}

#[cfg(test)]
mod tests;
