//! Pictures that are written a few rows at a time, so that their pixels need not be in memory.

use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use super::{Depth, Kind, exr, netpbm, png};
use crate::film::encode;
use crate::film::image::PixelsRef;
use crate::settings::Transfer;

/// Pixels that are given out at a time, about.
const BAND: u32 = 1 << 20;

/// A picture's pixels, rows from the top, wherever they are.
pub trait Rows: Sync {
    /// Gives the pixels of `rows`, each of `width` pixels.
    ///
    /// # Errors
    /// When there are no such rows, they cannot be read, or `take` fails.
    fn rows(
        &self,
        width: u32,
        rows: Range<u32>,
        take: &mut dyn FnMut(PixelsRef<'_>) -> io::Result<()>,
    ) -> io::Result<()>;
}

/// What a file holds: its kind, the bits of its codes, and what they mean.
pub(super) type Form = (Kind, Depth, Transfer);

/// Writes a picture of `width` x `height` as `form` says.
pub(super) fn write(
    to: &mut (impl Write + Seek),
    (width, height): (u32, u32),
    form: Form,
    source: &dyn Rows,
) -> io::Result<()> {
    let band = (BAND / width.max(1)).clamp(1, height.max(1));
    let bands = (0..height).step_by(band as usize).map(|y| y..height.min(y + band));
    match form {
        (Kind::Png, depth, transfer) => png::write_rows(to, (width, height), depth, transfer, |to| {
            bands.into_iter().try_for_each(|rows| source.rows(width, rows, &mut |p| to.write_all(&codes(p, form)?)))
        }),
        (Kind::Ppm, depth, _) => {
            netpbm::write_ppm(to, width, height, depth, &[])?;
            bands.into_iter().try_for_each(|rows| source.rows(width, rows, &mut |p| to.write_all(&codes(p, form)?)))
        }
        (Kind::Pfm, ..) => {
            netpbm::write_pfm(to, width, height, &[])?;
            let bands: Vec<_> = bands.collect();
            bands
                .into_iter()
                .rev()
                .try_for_each(|rows| source.rows(width, rows, &mut |p| netpbm::write_floats(to, width, floats(p)?)))
        }
        (Kind::Exr, ..) => {
            // Lines are asked for from the top, pixel by pixel.
            let held = Mutex::new((0..0, Vec::new(), None));
            let pixel = |x: usize, y: usize| {
                let (rows, pixels, failure) = &mut *held.lock().unwrap_or_else(PoisonError::into_inner);
                let y = y as u32;
                if !rows.contains(&y) {
                    *rows = y..height.min(y + band);
                    let read = source.rows(width, rows.clone(), &mut |p| {
                        *pixels = floats(p)?.to_vec();
                        Ok(())
                    });
                    if let Err(e) = read {
                        *pixels = vec![[0.0; 3]; rows.len() * width as usize];
                        failure.get_or_insert(e);
                    }
                }
                pixels[(y - rows.start) as usize * width as usize + x]
            };
            let begin = to.stream_position()?;
            let mut to = Furthest { to, at: begin, end: begin };
            exr::write_pixels(&mut to, width, height, pixel)?;
            to.seek(SeekFrom::Start(to.end))?;
            held.into_inner().unwrap_or_else(PoisonError::into_inner).2.map_or(Ok(()), Err)
        }
    }
}

/// Remembers the end of what was written: what is filled in last stands further up, and behind the end there may be
/// room that was reserved.
struct Furthest<W> {
    to: W,
    at: u64,
    end: u64,
}

impl<W: Write> Write for Furthest<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.to.write(bytes)?;
        self.at += written as u64;
        self.end = self.end.max(self.at);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

impl<W: Seek> Seek for Furthest<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.to.seek(to)?;
        Ok(self.at)
    }
}

/// Big-endian codes as a file of codes has them.
fn codes(pixels: PixelsRef<'_>, (kind, depth, transfer): Form) -> io::Result<Vec<u8>> {
    let words = |p: &[[u16; 3]]| p.as_flattened().iter().flat_map(|w| w.to_be_bytes()).collect();
    match (depth, pixels) {
        (Depth::Eight, PixelsRef::F32(p)) => Ok(encode::to_bytes(transfer, p).into_flattened()),
        (Depth::Sixteen, PixelsRef::F32(p)) => Ok(words(&encode::to_words(transfer, p))),
        (Depth::Eight, PixelsRef::Rgb8(p)) => Ok(p.as_flattened().to_vec()),
        (Depth::Sixteen, PixelsRef::Rgb16(p)) => Ok(words(p)),
        _ => Err(other_depth(kind)),
    }
}

fn floats(pixels: PixelsRef<'_>) -> io::Result<&[[f32; 3]]> {
    match pixels {
        PixelsRef::F32(p) => Ok(p),
        _ => Err(other_depth(Kind::Pfm)),
    }
}

fn other_depth(kind: Kind) -> io::Error {
    io::Error::other(format!("the pixels are not of the depth that a .{} file holds", kind.extension()))
}
