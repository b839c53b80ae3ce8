//! Pictures as pigments: arrays of colour components, row 0 at the top.

/// A picture of `width` × `height` pixels, each three components of the same depth.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    width: u32,
    height: u32,
    maxval: u16,
    /// Row by row from the top, red, green, blue; each at most `maxval`.
    samples: Samples,
}

/// Stored at the depth the file has: a byte where a byte suffices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Samples {
    Byte(Vec<u8>),
    Word(Vec<u16>),
}

/// Why samples do not make a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextureError {
    /// A picture has at least one pixel and at most [`Texture::MAX_SAMPLES`] samples.
    #[error("a picture of {0}x{1} pixels is empty or too large")]
    Size(u32, u32),
    /// Samples must be three for every pixel.
    #[error("{0} samples given where the size asks for {1}")]
    Length(usize, usize),
    /// Samples go from 0 to maxval, which is 1 to 65535.
    #[error("a sample exceeds the picture's largest value {0}, or that is 0")]
    Range(u16),
}

impl Texture {
    /// The most samples (3 × pixels) a picture may hold: 512 MiB of 16-bit ones.
    pub const MAX_SAMPLES: usize = 1 << 28;

    fn expected(width: u32, height: u32) -> Result<usize, TextureError> {
        (width as usize)
            .checked_mul(height as usize)
            .and_then(|n| n.checked_mul(3))
            .filter(|&n| n > 0 && n <= Self::MAX_SAMPLES)
            .ok_or(TextureError::Size(width, height))
    }

    /// A picture with `maxval` at most 255.
    ///
    /// # Errors
    /// When size, number of samples or a sample's value do not fit.
    pub fn from_bytes(width: u32, height: u32, maxval: u8, samples: Vec<u8>) -> Result<Self, TextureError> {
        let expected = Self::expected(width, height)?;
        if samples.len() != expected {
            return Err(TextureError::Length(samples.len(), expected));
        }
        if maxval == 0 || (maxval < u8::MAX && samples.iter().any(|&s| s > maxval)) {
            return Err(TextureError::Range(maxval.into()));
        }
        Ok(Self { width, height, maxval: maxval.into(), samples: Samples::Byte(samples) })
    }

    /// A picture with `maxval` from 256 to 65535.
    ///
    /// # Errors
    /// When size, number of samples or a sample's value do not fit.
    pub fn from_words(width: u32, height: u32, maxval: u16, samples: Vec<u16>) -> Result<Self, TextureError> {
        let expected = Self::expected(width, height)?;
        if samples.len() != expected {
            return Err(TextureError::Length(samples.len(), expected));
        }
        if maxval < 256 || (maxval < u16::MAX && samples.iter().any(|&s| s > maxval)) {
            return Err(TextureError::Range(maxval));
        }
        Ok(Self { width, height, maxval, samples: Samples::Word(samples) })
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }
    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }
    /// The sample value that means 1.
    #[must_use]
    pub fn maxval(&self) -> u16 {
        self.maxval
    }
    /// The samples where a byte holds each, rows from the top; `None` where they are words.
    #[must_use]
    pub fn bytes(&self) -> Option<&[u8]> {
        match &self.samples {
            Samples::Byte(b) => Some(b),
            Samples::Word(_) => None,
        }
    }
    /// The samples where each needs two bytes, rows from the top; `None` where they are bytes.
    #[must_use]
    pub fn words(&self) -> Option<&[u16]> {
        match &self.samples {
            Samples::Word(w) => Some(w),
            Samples::Byte(_) => None,
        }
    }
    /// Red, green and blue of a pixel, rows from the top, as stored: 0 to maxval each.
    ///
    /// # Panics
    /// When `pixel` is not below width × height.
    #[must_use]
    pub fn texel(&self, pixel: usize) -> [u16; 3] {
        let at = 3 * pixel;
        match &self.samples {
            Samples::Byte(b) => {
                let b = &b[at..at + 3];
                [b[0], b[1], b[2]].map(u16::from)
            }
            Samples::Word(w) => {
                let w = &w[at..at + 3];
                [w[0], w[1], w[2]]
            }
        }
    }
    /// Sample `index` (3 × pixel + component) as stored, 0 to maxval.
    ///
    /// # Panics
    /// When `index` is not below 3 × width × height.
    #[must_use]
    pub fn sample(&self, index: usize) -> u16 {
        match &self.samples {
            Samples::Byte(b) => b[index].into(),
            Samples::Word(w) => w[index],
        }
    }
}
