//! Texture files into memory.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;

use super::{Kind, exr, netpbm, png};
use crate::film::image::Image;
use crate::film::transfer::{from_linear, to_linear};
use crate::scene::Texture;
use crate::scene::pixmap::{self, PixmapError};
use crate::settings::Transfer;

/// Why a file is not a picture.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The extension names no kind of picture.
    #[error("its extension is none of {}", Kind::LIST)]
    Extension,
    /// No regular file.
    #[error("it is not a regular file")]
    NotAFile,
    /// The system refused.
    #[error("it cannot be read: {0}")]
    Io(#[source] io::Error),
    /// Empty or larger than this program reads.
    #[error("its size of {0}x{1} pixels is empty or above the limit of 89,478,485 pixels")]
    Size(u32, u32),
    /// Not of the format that its extension promises.
    #[error("{0}")]
    Broken(String),
}

/// A picture as a file stores it.
#[derive(Clone, Debug, PartialEq)]
pub struct Stored {
    /// The numbers of the file, codes as shares of the largest code.
    pub image: Image,
    /// What the numbers mean, where they are codes; `None` where they are linear floats.
    pub transfer: Option<Transfer>,
}

impl Stored {
    /// The picture with its numbers meant as `transfer` says, clamped to [0, 1] where they change.
    #[must_use]
    pub fn in_transfer(self, transfer: Transfer) -> Image {
        let from = self.transfer.unwrap_or(Transfer::Linear);
        if from == transfer {
            return self.image;
        }
        self.image.map(|x| from_linear(transfer, to_linear(from, f64::from(x.clamp(0.0, 1.0)))) as f32)
    }
}

/// Reads the picture at `path`, its kind by its extension. A pixmap's codes are taken as sRGB.
///
/// # Errors
/// When it is no regular file, of no known kind, too large or broken.
pub fn read(path: &Path) -> Result<Stored, ReadError> {
    let kind = Kind::of(path).ok_or(ReadError::Extension)?;
    let metadata = std::fs::metadata(path).map_err(ReadError::Io)?;
    if !metadata.is_file() {
        return Err(ReadError::NotAFile);
    }
    if kind == Kind::Ppm {
        return pixmap::load(path).map_err(from_pixmap).map(|p| from_picture(&p));
    }
    let file = BufReader::with_capacity(1 << 17, File::open(path).map_err(ReadError::Io)?);
    match kind {
        Kind::Png => png::read(file),
        Kind::Pfm => Ok(Stored { image: netpbm::read_pfm(file, metadata.len())?, transfer: None }),
        Kind::Exr => Ok(Stored { image: exr::read(file)?, transfer: None }),
        Kind::Ppm => Err(ReadError::Extension),
    }
}

/// The number of pixels, where it is within what is read.
pub(super) fn pixel_count(width: u32, height: u32) -> Result<u64, ReadError> {
    let count = u64::from(width) * u64::from(height);
    if count == 0 || count > Texture::MAX_SAMPLES as u64 / 3 {
        return Err(ReadError::Size(width, height));
    }
    Ok(count)
}

fn from_pixmap(error: PixmapError) -> ReadError {
    match error {
        PixmapError::Missing => ReadError::Io(io::ErrorKind::NotFound.into()),
        PixmapError::NotAFile(_) => ReadError::NotAFile,
        PixmapError::Io(e) => ReadError::Io(e),
        e => ReadError::Broken(e.to_string()),
    }
}

fn from_picture(picture: &Texture) -> Stored {
    let share = |i| f32::from(picture.sample(i)) / f32::from(picture.maxval());
    let count = picture.width() as usize * picture.height() as usize;
    let pixels = (0..count).map(|p| [share(3 * p), share(3 * p + 1), share(3 * p + 2)]).collect();
    let image = Image::new(picture.width(), picture.height(), pixels);
    let image = image.unwrap_or_else(|| unreachable!("a picture has all its pixels"));
    Stored { image, transfer: Some(Transfer::Srgb) }
}
