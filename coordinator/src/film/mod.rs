//! The pixels of a picture while it is made and until it is written: in memory, or, where they are many, in a file
//! without a name, of which the system keeps in memory what there is room for.

mod canvas;

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use sha2::{Digest, Sha256};
use tessera_core::film::PixelsRef;
use tessera_core::film::file::Rows;
use tessera_proto::convert::pixel_bytes;
use tessera_proto::{PixelFormat, Pixels};

use crate::error::RenderError;

pub use canvas::Canvas;
pub(crate) use canvas::{Excerpt, TileNote, View, look};

/// Bytes of pixels that are kept in memory, at most: a picture of 16,384 x 10,922 in 8 bits.
const IN_MEMORY: u64 = 512 << 20;
/// Bytes that are read, or pixels that are given, at a time.
const CHUNK: usize = 1 << 20;

/// Where the pixels of large pictures go while they are made.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// The folder of their file; the system's for temporary files where there is none.
    pub folder: Option<PathBuf>,
    /// Bytes of pixels up to which there is no such file.
    pub in_memory: u64,
}

impl Scratch {
    /// The folder, as the system has it.
    fn folder(&self) -> PathBuf {
        match &self.folder {
            Some(folder) if folder.as_os_str().is_empty() => ".".into(),
            Some(folder) => folder.clone(),
            None => std::env::temp_dir(),
        }
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self { folder: None, in_memory: IN_MEMORY }
    }
}

/// A picture's pixels, rows from the top.
#[derive(Debug)]
pub enum Film {
    /// In memory.
    Memory(Pixels),
    /// In a file that is gone when this is.
    Disk(OnDisk),
}

/// Pixels in a file: little-endian components, as workers send them.
#[derive(Debug)]
pub struct OnDisk {
    file: Mutex<File>,
    folder: PathBuf,
    format: PixelFormat,
    len: u64,
}

impl Film {
    /// `len` black pixels.
    ///
    /// # Errors
    /// [`RenderError::Memory`] where there is no memory for them, [`RenderError::Scratch`] where the folder takes no
    /// file of their size.
    pub(crate) fn black(format: PixelFormat, len: u64, scratch: &Scratch) -> Result<Self, RenderError> {
        let bytes = len.saturating_mul(format.bytes_per_pixel() as u64);
        if bytes <= scratch.in_memory {
            let count = usize::try_from(len).ok();
            let pixels = count.and_then(|count| Pixels::black(format, count));
            return pixels.map(Self::Memory).ok_or(RenderError::Memory(len));
        }
        let folder = scratch.folder();
        let made = tempfile::tempfile_in(&folder).and_then(|file| {
            // A hole, which reads as zeros and takes no room before it is written to.
            file.set_len(bytes)?;
            Ok(file)
        });
        match made {
            Ok(file) => Ok(Self::Disk(OnDisk { file: Mutex::new(file), folder, format, len })),
            Err(e) => Err(RenderError::Scratch(folder, e)),
        }
    }

    /// Their format.
    #[must_use]
    pub fn format(&self) -> PixelFormat {
        match self {
            Self::Memory(pixels) => pixels.format(),
            Self::Disk(disk) => disk.format,
        }
    }

    /// The pixels, where they are in memory.
    #[must_use]
    pub fn pixels(&self) -> Option<&Pixels> {
        match self {
            Self::Memory(pixels) => Some(pixels),
            Self::Disk(_) => None,
        }
    }

    /// As [`Self::pixels`].
    #[must_use]
    pub fn into_pixels(self) -> Option<Pixels> {
        match self {
            Self::Memory(pixels) => Some(pixels),
            Self::Disk(_) => None,
        }
    }

    /// Overwrites pixels from index `at` on with `bytes` of their own format; `first`: they were black before.
    ///
    /// # Errors
    /// [`RenderError::Scratch`] where the disk does not take them.
    ///
    /// # Panics
    /// When the bytes reach beyond the end.
    pub(crate) fn put(&mut self, at: u64, bytes: &[u8], first: bool) -> Result<(), RenderError> {
        match self {
            Self::Memory(pixels) => pixels.put(at as usize, bytes),
            // Black stays a hole.
            Self::Disk(_) if first && bytes.iter().all(|b| *b == 0) => {}
            Self::Disk(disk) => disk.write(at, bytes).map_err(|e| RenderError::Scratch(disk.folder.clone(), e))?,
        }
        Ok(())
    }

    /// Gives all pixels as little-endian bytes, piece by piece.
    ///
    /// # Errors
    /// When the disk does not give them, or `take` fails.
    pub(crate) fn for_bytes(&self, mut take: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<()> {
        match self {
            Self::Memory(pixels) => {
                let pixels = PixelsRef::from(pixels);
                (0..pixels.len()).step_by(CHUNK).try_for_each(|at| {
                    let piece = pixels.get(at..pixels.len().min(at + CHUNK)).ok_or_else(beyond)?;
                    take(&pixel_bytes(piece))
                })
            }
            Self::Disk(disk) => {
                let mut file = disk.file();
                file.seek(SeekFrom::Start(0))?;
                let mut piece = vec![0; CHUNK];
                loop {
                    match file.read(&mut piece)? {
                        0 => return Ok(()),
                        n => take(&piece[..n])?,
                    }
                }
            }
        }
    }

    /// SHA-256 of the pixels as little-endian components, in hexadecimal.
    ///
    /// # Errors
    /// When the disk does not give them.
    pub fn sha256(&self) -> io::Result<String> {
        let mut hash = Sha256::new();
        self.for_bytes(|bytes| {
            hash.update(bytes);
            Ok(())
        })?;
        Ok(hash.finalize().iter().map(|b| format!("{b:02x}")).collect())
    }
}

impl PartialEq<Pixels> for Film {
    fn eq(&self, other: &Pixels) -> bool {
        self.pixels() == Some(other)
    }
}

impl PartialEq for Film {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Memory(a), Self::Memory(b)) => a == b,
            (a, b) => a.format() == b.format() && a.sha256().is_ok_and(|a| b.sha256().is_ok_and(|b| a == b)),
        }
    }
}

impl Rows for Film {
    fn rows(
        &self,
        width: u32,
        rows: Range<u32>,
        take: &mut dyn FnMut(PixelsRef<'_>) -> io::Result<()>,
    ) -> io::Result<()> {
        let at = |row: u32| u64::from(row) * u64::from(width);
        let range = at(rows.start)..at(rows.end);
        match self {
            Self::Memory(pixels) => {
                let range = range.start as usize..range.end as usize;
                take(PixelsRef::from(pixels).get(range).ok_or_else(beyond)?)
            }
            Self::Disk(disk) => take(PixelsRef::from(&disk.read(range)?)),
        }
    }
}

impl OnDisk {
    fn file(&self) -> MutexGuard<'_, File> {
        self.file.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn place(&self, at: u64) -> SeekFrom {
        SeekFrom::Start(at * self.format.bytes_per_pixel() as u64)
    }

    fn write(&self, at: u64, bytes: &[u8]) -> io::Result<()> {
        let end = at + (bytes.len() / self.format.bytes_per_pixel()) as u64;
        assert!(end <= self.len, "pixels beyond the end");
        let mut file = self.file();
        file.seek(self.place(at))?;
        file.write_all(bytes)
    }

    /// The pixels of `range`.
    ///
    /// # Errors
    /// When the disk does not give them, or there are no such pixels.
    pub(crate) fn read(&self, range: Range<u64>) -> io::Result<Pixels> {
        let count = range.end.checked_sub(range.start).filter(|_| range.end <= self.len).ok_or_else(beyond)?;
        let mut pixels = Pixels::black(self.format, count as usize).ok_or(io::ErrorKind::OutOfMemory)?;
        let mut bytes = vec![0; count as usize * self.format.bytes_per_pixel()];
        let mut file = self.file();
        file.seek(self.place(range.start))?;
        file.read_exact(&mut bytes)?;
        pixels.put(0, &bytes);
        Ok(pixels)
    }
}

fn beyond() -> io::Error {
    io::Error::other("there are no such pixels")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_film_on_disk_is_as_one_in_memory() {
        let at = tempfile::tempdir().unwrap();
        let on_disk = Scratch { folder: Some(at.path().into()), in_memory: 0 };
        for format in [PixelFormat::Rgb8, PixelFormat::Rgb16, PixelFormat::F32] {
            let mut films = [Scratch::default(), on_disk.clone()].map(|s| Film::black(format, 12, &s).unwrap());
            assert!(films[0].pixels().is_some() && films[1].pixels().is_none());
            let row = |n: u8| vec![n; 3 * format.bytes_per_pixel()];
            for film in &mut films {
                for (place, n, first) in [(0, 1, true), (3, 0, true), (6, 7, true), (9, 9, true), (6, 0, false)] {
                    film.put(place, &row(n), first).unwrap();
                }
            }
            let [memory, disk] = &films;
            assert!(memory == disk && memory.sha256().unwrap() == disk.sha256().unwrap());
            let seen = |film: &Film, rows| {
                let mut seen = Vec::new();
                film.rows(2, rows, &mut |pixels| {
                    seen.push(format!("{pixels:?}"));
                    Ok(())
                })?;
                io::Result::Ok(seen)
            };
            assert_eq!(seen(memory, 1..5).unwrap(), seen(disk, 1..5).unwrap());
            assert!(seen(memory, 5..7).is_err() && seen(disk, 5..7).is_err());
            assert_eq!(std::fs::read_dir(at.path()).unwrap().count(), 0, "it has a name");
        }
    }
}
