//! Pieces of bytes into a scene, nothing in them trusted.

use glam::DVec3;
use tessera_core::scene::{
    Invalid, Orientation, Pigment, PlanePosition, Scene, SceneBuilder, Surface, SurfaceId, Texture, TextureError,
    TextureId,
};

use super::{
    MAGIC, PLANE_DISTANCE, PLANE_POINT, SPHERE, SPHERE_ORIENTED, TRIANGLE_CORNERS, TRIANGLE_SIDES, object_bytes,
};
use crate::limits::MAX_SCENE_BYTES;

/// Why bytes are not a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// Longer than a scene may be.
    #[error("a scene of {0} bytes is over the limit of {MAX_SCENE_BYTES}")]
    TooLong(u64),
    /// More or fewer bytes than declared.
    #[error("the scene's bytes do not add up to the {declared} declared ({got} came)")]
    Length {
        /// Bytes declared.
        declared: u64,
        /// Bytes that came.
        got: u64,
    },
    /// Not this format.
    #[error("this is not a scene of this version")]
    Magic,
    /// A count in more than 32 bits.
    #[error("a count is malformed")]
    Count,
    /// More things than the bytes could hold, or than were declared.
    #[error("the scene's counts do not fit its {0} bytes")]
    Counts(u64),
    /// A kind that is not known.
    #[error("unknown kind {0}")]
    Kind(u8),
    /// A value that no scene may hold.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// A texture that is none.
    #[error(transparent)]
    Texture(#[from] TextureError),
}

/// Reads a scene piece by piece; the pieces may be cut anywhere.
///
/// Memory follows the bytes that came, not what they declare.
#[derive(Debug)]
pub struct SceneDecoder {
    builder: SceneBuilder,
    /// Came and not yet read: less than one object, beside the newest piece.
    buffer: Vec<u8>,
    declared: u64,
    got: u64,
    left: Counts,
    at: At,
}

/// How many of each are still to come.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    lights: u32,
    textures: u32,
    surfaces: u32,
    planes: u32,
    spheres: u32,
    triangles: u32,
}

/// What is read next.
#[derive(Debug)]
enum At {
    Head,
    Lights,
    Textures,
    Samples { width: u32, height: u32, maxval: u16, samples: Samples, wanted: usize },
    Surfaces,
    Runs,
    Run { kind: u8, surface: SurfaceId, left: u32 },
    Done,
}

#[derive(Debug)]
enum Samples {
    Bytes(Vec<u8>),
    Words(Vec<u16>),
}

/// Reads from the front of what is there; `None` where more is needed.
struct Reader<'b>(&'b [u8]);

impl<'b> Reader<'b> {
    fn take(&mut self, n: usize) -> Option<&'b [u8]> {
        let (head, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(head)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take(1).map(|b| b[0])
    }

    fn count(&mut self) -> Result<Option<u32>, SceneError> {
        let mut n = 0u64;
        for shift in (0..35).step_by(7) {
            let Some(b) = self.byte() else { return Ok(None) };
            n |= u64::from(b & 0x7f) << shift;
            if b < 0x80 {
                return u32::try_from(n).map(Some).map_err(|_| SceneError::Count);
            }
        }
        Err(SceneError::Count)
    }

    fn numbers<const N: usize>(&mut self) -> Option<[f64; N]> {
        self.take(8 * N).map(numbers)
    }

    fn vec(&mut self) -> Option<DVec3> {
        self.numbers().map(DVec3::from_array)
    }
}

/// `N` numbers from the front of `bytes`, which are long enough.
fn numbers<const N: usize>(bytes: &[u8]) -> [f64; N] {
    let (words, _) = bytes.as_chunks::<8>();
    std::array::from_fn(|i| f64::from_le_bytes(words[i]))
}

fn vec_at(bytes: &[u8], index: usize) -> DVec3 {
    DVec3::from_array(numbers(&bytes[24 * index..]))
}

/// Unwraps an `Option` of [`Reader`], or leaves the step to wait for more bytes.
macro_rules! need {
    ($e:expr) => {
        match $e {
            Some(v) => v,
            None => return Ok(None),
        }
    };
}

impl SceneDecoder {
    /// A reader of a scene whose binary form is `declared` bytes long.
    ///
    /// # Errors
    /// When that is longer than any scene may be.
    pub fn new(declared: u64) -> Result<Self, SceneError> {
        if declared > MAX_SCENE_BYTES {
            return Err(SceneError::TooLong(declared));
        }
        Ok(Self {
            builder: SceneBuilder::new(),
            buffer: Vec::new(),
            declared,
            got: 0,
            left: Counts::default(),
            at: At::Head,
        })
    }

    /// Takes the next piece.
    ///
    /// # Errors
    /// At the first thing that is wrong; the decoder is of no more use then.
    pub fn push(&mut self, piece: &[u8]) -> Result<(), SceneError> {
        self.got += piece.len() as u64;
        if self.got > self.declared {
            return Err(SceneError::Length { declared: self.declared, got: self.got });
        }
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.extend_from_slice(piece);
        let mut rest = buffer.as_slice();
        while let Some(read) = self.step(rest)? {
            rest = &rest[read..];
        }
        let start = buffer.len() - rest.len();
        buffer.drain(..start);
        self.buffer = buffer;
        Ok(())
    }

    /// The scene, all pieces taken.
    ///
    /// # Errors
    /// When bytes are missing or left over, or the scene as a whole is none.
    pub fn finish(self) -> Result<Scene, SceneError> {
        if self.got != self.declared || !matches!(self.at, At::Done) || !self.buffer.is_empty() {
            return Err(SceneError::Length { declared: self.declared, got: self.got });
        }
        Ok(self.builder.finish()?)
    }

    /// Reads one thing from the front of `bytes` and says how many it took, or `None` where
    /// more are needed or nothing is left to read.
    fn step(&mut self, bytes: &[u8]) -> Result<Option<usize>, SceneError> {
        let mut r = Reader(bytes);
        let read = match self.at {
            At::Head => self.head(&mut r),
            At::Lights => self.light(&mut r),
            At::Textures => self.texture(&mut r),
            At::Samples { .. } => self.samples(&mut r),
            At::Surfaces => self.surface(&mut r),
            At::Runs => self.run(&mut r),
            At::Run { .. } => self.objects(&mut r),
            At::Done => Ok(None),
        };
        Ok(read?.map(|()| bytes.len() - r.0.len()))
    }

    fn light(&mut self, r: &mut Reader<'_>) -> Result<Option<()>, SceneError> {
        if self.left.lights == 0 {
            self.at = At::Textures;
        } else {
            self.builder.light(need!(r.vec()))?;
            self.left.lights -= 1;
        }
        Ok(Some(()))
    }

    /// What comes before a texture's samples.
    fn texture(&mut self, r: &mut Reader<'_>) -> Result<Option<()>, SceneError> {
        if self.left.textures == 0 {
            self.at = At::Surfaces;
            return Ok(Some(()));
        }
        let (width, height) = (need!(r.count()?), need!(r.count()?));
        let maxval = u16::try_from(need!(r.count()?)).map_err(|_| SceneError::Count)?;
        let wanted = (u64::from(width) * u64::from(height))
            .checked_mul(3)
            .and_then(|n| usize::try_from(n).ok())
            .filter(|&n| n > 0 && n <= Texture::MAX_SAMPLES)
            .ok_or(TextureError::Size(width, height))?;
        let samples = if maxval < 256 { Samples::Bytes(Vec::new()) } else { Samples::Words(Vec::new()) };
        self.at = At::Samples { width, height, maxval, samples, wanted };
        self.left.textures -= 1;
        Ok(Some(()))
    }

    /// As many samples of a texture as are there; after the last, the texture.
    fn samples(&mut self, r: &mut Reader<'_>) -> Result<Option<()>, SceneError> {
        let At::Samples { samples, wanted, .. } = &mut self.at else { return Ok(None) };
        let before = r.0.len();
        let have = match samples {
            Samples::Bytes(have) => {
                let n = (*wanted - have.len()).min(r.0.len());
                have.extend_from_slice(need!(r.take(n)));
                have.len()
            }
            Samples::Words(have) => {
                let n = (*wanted - have.len()).min(r.0.len() / 2);
                let (words, _) = need!(r.take(2 * n)).as_chunks::<2>();
                have.extend(words.iter().map(|&w| u16::from_le_bytes(w)));
                have.len()
            }
        };
        if have < *wanted {
            // Everything that was there is taken; to have taken nothing would read as "go on".
            return Ok((r.0.len() < before).then_some(()));
        }
        let At::Samples { width, height, maxval, samples, .. } = std::mem::replace(&mut self.at, At::Textures) else {
            return Ok(None);
        };
        self.builder.texture(match samples {
            Samples::Bytes(s) => Texture::from_bytes(width, height, maxval as u8, s)?,
            Samples::Words(s) => Texture::from_words(width, height, maxval, s)?,
        })?;
        Ok(Some(()))
    }

    fn surface(&mut self, r: &mut Reader<'_>) -> Result<Option<()>, SceneError> {
        if self.left.surfaces == 0 {
            self.at = At::Runs;
            return Ok(Some(()));
        }
        let [diffuse, reflect] = need!(r.numbers());
        let pigment = match need!(r.byte()) {
            0 => Pigment::Color(need!(r.numbers())),
            1 => Pigment::Texture(TextureId(need!(r.count()?))),
            kind => return Err(SceneError::Kind(kind)),
        };
        self.builder.surface(Surface { diffuse, reflect, pigment })?;
        self.left.surfaces -= 1;
        Ok(Some(()))
    }

    /// What comes before objects of one kind and surface.
    fn run(&mut self, r: &mut Reader<'_>) -> Result<Option<()>, SceneError> {
        let left = &mut self.left;
        if left.planes == 0 && left.spheres == 0 && left.triangles == 0 {
            self.at = At::Done;
            return Ok(Some(()));
        }
        let (kind, surface, length) = (need!(r.byte()), need!(r.count()?), need!(r.count()?));
        let of_kind = match kind {
            PLANE_POINT | PLANE_DISTANCE => &mut left.planes,
            SPHERE | SPHERE_ORIENTED => &mut left.spheres,
            TRIANGLE_CORNERS | TRIANGLE_SIDES => &mut left.triangles,
            _ => return Err(SceneError::Kind(kind)),
        };
        *of_kind = of_kind.checked_sub(length).ok_or(SceneError::Counts(self.declared))?;
        self.at = At::Run { kind, surface: SurfaceId(surface), left: length };
        Ok(Some(()))
    }

    /// As many objects of a run as are there.
    fn objects(&mut self, r: &mut Reader<'_>) -> Result<Option<()>, SceneError> {
        let At::Run { kind, surface, left } = &mut self.at else { return Ok(None) };
        let (kind, surface) = (*kind, *surface);
        let size = object_bytes(kind).ok_or(SceneError::Kind(kind))?;
        let n = (*left as usize).min(r.0.len() / size);
        if n == 0 && *left > 0 {
            return Ok(None);
        }
        *left -= n as u32;
        if *left == 0 {
            self.at = At::Runs;
        }
        for object in need!(r.take(n * size)).chunks_exact(size) {
            add(&mut self.builder, kind, surface, object)?;
        }
        Ok(Some(()))
    }

    fn head(&mut self, r: &mut Reader<'_>) -> Result<Option<()>, SceneError> {
        if need!(r.take(8)) != MAGIC {
            return Err(SceneError::Magic);
        }
        let mut counts = [0; 6];
        for n in &mut counts {
            *n = need!(r.count()?);
        }
        let [lights, textures, surfaces, planes, spheres, triangles] = counts;
        let (location, sky, look_at) = (need!(r.vec()), need!(r.vec()), need!(r.vec()));
        let background = need!(r.numbers());
        // The least that this many things take; what follows cannot be shorter.
        let least = [(lights, 24), (textures, 6), (surfaces, 18), (planes, 32), (spheres, 32), (triangles, 72)];
        if least.iter().map(|&(n, bytes)| u64::from(n) * bytes).sum::<u64>() > self.declared {
            return Err(SceneError::Counts(self.declared));
        }
        self.builder.camera(location, sky, look_at)?;
        self.builder.background(background)?;
        // Exact where that is cheap to be wrong about; beyond, memory grows with what comes.
        let room = |n: u32| n.min(1 << 21) as usize;
        self.builder.reserve(room(triangles), room(spheres));
        self.left = Counts { lights, textures, surfaces, planes, spheres, triangles };
        self.at = At::Lights;
        Ok(Some(()))
    }
}

fn add(builder: &mut SceneBuilder, kind: u8, surface: SurfaceId, object: &[u8]) -> Result<(), SceneError> {
    let v = |i| vec_at(object, i);
    let number = |i: usize| numbers::<1>(&object[8 * i..])[0];
    match kind {
        PLANE_POINT => builder.plane(v(0), PlanePosition::Point(v(1)), surface)?,
        PLANE_DISTANCE => builder.plane(v(0), PlanePosition::Distance(number(3)), surface)?,
        SPHERE => builder.sphere(v(0), number(3), None, surface)?,
        SPHERE_ORIENTED => {
            let pole = DVec3::from_array(numbers(&object[32..]));
            let equator = DVec3::from_array(numbers(&object[56..]));
            builder.sphere(v(0), number(3), Some(Orientation { pole, equator }), surface)?;
        }
        TRIANGLE_CORNERS => builder.triangle([v(0), v(1), v(2)], surface)?,
        _ => builder.triangle_by_sides(v(0), [v(1), v(2)], surface)?,
    }
    Ok(())
}
