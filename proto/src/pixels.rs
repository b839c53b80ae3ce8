//! Pixels as they travel: in the form the output needs, and no wider.

use tessera_core::film::PixelsRef;

/// What a pixel's three components are sent as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// 8 bits each, clamped and transfer-encoded: for 8-bit files.
    Rgb8,
    /// 16 bits each, clamped and transfer-encoded: for 16-bit files.
    Rgb16,
    /// Linear 32-bit floats, unclamped: for floating-point files and hashes.
    F32,
}

impl PixelFormat {
    /// All there are.
    pub const ALL: [Self; 3] = [Self::Rgb8, Self::Rgb16, Self::F32];

    /// Bytes of one pixel on the wire.
    #[must_use]
    pub fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Rgb8 => 3,
            Self::Rgb16 => 6,
            Self::F32 => 12,
        }
    }
}

/// Pixels of one format, red, green, blue; row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// See [`PixelFormat::Rgb8`].
    Rgb8(Vec<[u8; 3]>),
    /// See [`PixelFormat::Rgb16`].
    Rgb16(Vec<[u16; 3]>),
    /// See [`PixelFormat::F32`].
    F32(Vec<[f32; 3]>),
}

impl<'a> From<&'a Pixels> for PixelsRef<'a> {
    fn from(pixels: &'a Pixels) -> Self {
        match pixels {
            Pixels::Rgb8(p) => Self::Rgb8(p),
            Pixels::Rgb16(p) => Self::Rgb16(p),
            Pixels::F32(p) => Self::F32(p),
        }
    }
}

impl Pixels {
    /// `count` black pixels, or `None` where there is no memory for them.
    #[must_use]
    pub fn black(format: PixelFormat, count: usize) -> Option<Self> {
        fn filled<P: Clone + Default>(count: usize) -> Option<Vec<P>> {
            let mut pixels = Vec::new();
            pixels.try_reserve_exact(count).ok()?;
            pixels.resize(count, Default::default());
            Some(pixels)
        }
        Some(match format {
            PixelFormat::Rgb8 => Self::Rgb8(filled(count)?),
            PixelFormat::Rgb16 => Self::Rgb16(filled(count)?),
            PixelFormat::F32 => Self::F32(filled(count)?),
        })
    }

    /// Their format.
    #[must_use]
    pub fn format(&self) -> PixelFormat {
        match self {
            Self::Rgb8(_) => PixelFormat::Rgb8,
            Self::Rgb16(_) => PixelFormat::Rgb16,
            Self::F32(_) => PixelFormat::F32,
        }
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Rgb8(p) => p.len(),
            Self::Rgb16(p) => p.len(),
            Self::F32(p) => p.len(),
        }
    }

    /// Overwrites pixels from index `at` on with `bytes` of their own format.
    ///
    /// # Panics
    /// When the bytes reach beyond the end.
    pub fn put(&mut self, at: usize, bytes: &[u8]) {
        let count = bytes.len() / self.format().bytes_per_pixel();
        let range = at..at + count;
        match self {
            Self::Rgb8(p) => p[range].as_flattened_mut().copy_from_slice(&bytes[..3 * count]),
            Self::Rgb16(p) => {
                for (c, b) in p[range].as_flattened_mut().iter_mut().zip(bytes.as_chunks().0) {
                    *c = u16::from_le_bytes(*b);
                }
            }
            Self::F32(p) => {
                for (c, b) in p[range].as_flattened_mut().iter_mut().zip(bytes.as_chunks().0) {
                    *c = f32::from_le_bytes(*b);
                }
            }
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
