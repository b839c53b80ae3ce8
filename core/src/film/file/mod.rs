//! Texture files: PNG, PPM, PFM, EXR.

mod atomic;
mod exr;
mod netpbm;
mod output;
mod png;
mod read;
mod rows;

pub use atomic::remove_temporaries;
pub use output::{Output, OutputError, Reserved, plan_text, write_text};
pub use read::{ReadError, Stored, read};
pub use rows::Rows;

use std::path::Path;

/// Kinds of picture files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Portable network graphics, 8 or 16 bits.
    Png,
    /// Portable pixmap (P6), 8 or 16 bits.
    Ppm,
    /// Portable float map, linear f32.
    Pfm,
    /// OpenEXR, linear f32.
    Exr,
}

impl Kind {
    /// The kinds as an error message lists them.
    pub const LIST: &'static str = ".png, .ppm, .pfm or .exr";

    /// The kind that a file name's extension stands for, in any case of letters.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        [Self::Png, Self::Ppm, Self::Pfm, Self::Exr].into_iter().find(|k| k.extension() == extension)
    }

    /// Its extension, without the dot.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Ppm => "ppm",
            Self::Pfm => "pfm",
            Self::Exr => "exr",
        }
    }

    /// Whether it holds linear floats rather than codes.
    #[must_use]
    pub fn is_float(self) -> bool {
        matches!(self, Self::Pfm | Self::Exr)
    }
}

/// Bits of a code in PNG and PPM files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Depth {
    /// 0 to 255.
    #[default]
    Eight,
    /// 0 to 65535.
    Sixteen,
}

impl Depth {
    /// How many.
    #[must_use]
    pub fn bits(self) -> u8 {
        match self {
            Self::Eight => 8,
            Self::Sixteen => 16,
        }
    }
}

#[cfg(test)]
mod tests;
