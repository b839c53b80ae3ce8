//! Where a picture will go: checked before it is rendered, written whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use super::atomic::{Temporary, is_no_room};
use super::{Depth, Kind, Rows, exr, netpbm, png, rows};
use crate::film::encode;
use crate::film::image::PixelsRef;
use crate::settings::Transfer;

/// Why a picture cannot be written where it should.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The extension names no kind of picture.
    #[error(
        "'{path}' {what}: a picture's name ends in {list}", path = .0.display(), list = Kind::LIST,
        what = match .0.extension() {
            Some(e) => format!("ends in .{}, which is no kind of picture this program writes", e.display()),
            None => "has no extension".into(),
        }
    )]
    Extension(PathBuf),
    /// The folder is not there.
    #[error("the folder '{}' does not exist; create it, or choose another place for '{}'", .0.display(), .1.display())]
    NoFolder(PathBuf, PathBuf),
    /// What should be the folder is something else.
    #[error("'{}' is not a folder, so '{}' cannot be written into it", .0.display(), .1.display())]
    NotAFolder(PathBuf, PathBuf),
    /// Files cannot be made in the folder.
    #[error("cannot write into the folder '{}': {}", .0.display(), .1)]
    Folder(PathBuf, io::Error),
    /// The name belongs to a folder, device or FIFO.
    #[error("'{}' exists and is {}, not a file; choose another name", .0.display(), .1)]
    NotAFile(PathBuf, &'static str),
    /// The disk is full.
    #[error("'{}' will not fit on its disk: it may take {} bytes, and {}; make room, or choose another place", .0.display(), .1, .2)]
    NoRoom(PathBuf, u64, io::Error),
    /// The system refused while the picture was being written.
    #[error("cannot write '{}': {}", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

/// A picture file to come.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Output {
    path: PathBuf,
    /// Where `path` leads, should it be a symbolic link.
    target: PathBuf,
    kind: Kind,
    depth: Depth,
    transfer: Transfer,
}

/// Makes sure that a text can be written to `path` by [`write_text`]. Nothing is left behind.
///
/// # Errors
/// When its folder is not there or takes no files, or the name is not a file's.
pub fn plan_text(path: &Path) -> Result<(), OutputError> {
    if is_stream(path) { Ok(()) } else { place(path).map(drop) }
}

/// Writes `text` to `path`: to a file whole or not at all, to a device or FIFO as it comes.
///
/// # Errors
/// When the system refuses.
pub fn write_text(path: &Path, text: &str) -> Result<(), OutputError> {
    if is_stream(path) {
        return std::fs::write(path, text).map_err(|e| OutputError::Write(path.into(), e));
    }
    write_whole(path, &place(path)?, |to| to.write_all(text.as_bytes()))
}

/// Whether `path` is there and neither file nor folder, such as `/dev/stdout`.
fn is_stream(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// The file that `path` leads to through symbolic links, its place known to take files.
fn place(path: &Path) -> Result<PathBuf, OutputError> {
    let linked = path.is_symlink().then(|| std::fs::canonicalize(path).ok()).flatten();
    let target = linked.unwrap_or_else(|| path.into());
    let folder = match target.parent() {
        Some(p) if !p.as_os_str().is_empty() => p.to_path_buf(),
        _ => PathBuf::from("."),
    };
    match std::fs::metadata(&folder) {
        Ok(m) if m.is_dir() => {}
        Ok(_) => return Err(OutputError::NotAFolder(folder, path.into())),
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Err(OutputError::NoFolder(folder, path.into())),
        Err(e) if e.kind() == io::ErrorKind::NotADirectory => {
            return Err(OutputError::NotAFolder(folder, path.into()));
        }
        Err(e) => return Err(OutputError::Folder(folder, e)),
    }
    match std::fs::metadata(&target) {
        Ok(m) if m.is_dir() => return Err(OutputError::NotAFile(path.into(), "a folder")),
        Ok(m) if !m.is_file() => return Err(OutputError::NotAFile(path.into(), "a device, FIFO or socket")),
        _ => {}
    }
    Temporary::clear_leftovers(&target);
    // The one sure way to know that files can be made is to make one.
    drop(Temporary::beside(&target).map_err(|e| OutputError::Folder(folder, e))?);
    Ok(target)
}

/// Writes `target` (called `path`) under a temporary name first, so that nothing unfinished ever bears its own.
fn write_whole(
    path: &Path,
    target: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> Result<(), OutputError> {
    let temporary = Temporary::beside(target).map_err(|e| OutputError::Write(path.into(), e))?;
    fill(temporary, path, target, write, false)
}

/// Writes `temporary` and gives it the name `target`; `durable`: not before it is on the disk.
fn fill(
    mut temporary: Temporary,
    path: &Path,
    target: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
    durable: bool,
) -> Result<(), OutputError> {
    let whole = || {
        let file = temporary.file();
        let mut to = BufWriter::with_capacity(1 << 18, &mut *file);
        write(&mut to)?;
        to.flush()?;
        drop(to);
        // More may have been reserved.
        let end = file.stream_position()?;
        file.set_len(end)?;
        if durable { file.sync_data() } else { Ok(()) }
    };
    let failed = |e| OutputError::Write(path.into(), e);
    whole().map_err(failed)?;
    temporary.keep(target).map_err(failed)
}

/// Room on the disk for a picture to come; given back when dropped.
#[derive(Debug)]
pub struct Reserved(Temporary);

impl Output {
    /// Makes sure that a picture can be written to `path`: its kind is known, its folder
    /// is there and takes new files. Nothing is left behind.
    ///
    /// # Errors
    /// When one of these fails.
    pub fn plan(path: &Path, depth: Depth, transfer: Transfer) -> Result<Self, OutputError> {
        let kind = Kind::of(path).ok_or_else(|| OutputError::Extension(path.into()))?;
        let target = place(path)?;
        Ok(Self { path: path.into(), target, kind, depth, transfer })
    }

    /// The name as it was given.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The kind of file.
    #[must_use]
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Bits of a code, where the file holds codes.
    #[must_use]
    pub fn depth(&self) -> Option<Depth> {
        (!self.kind.is_float()).then_some(self.depth)
    }

    /// The output of what could be rendered before an interruption: NAME.partial.EXT, in the same folder.
    #[must_use]
    pub fn partial(&self) -> Self {
        let rename = |p: &Path| {
            let mut name = p.file_stem().unwrap_or_default().to_os_string();
            name.push(format!(".partial.{}", p.extension().unwrap_or_default().to_string_lossy()));
            p.with_file_name(name)
        };
        Self { path: rename(&self.path), target: rename(&self.target), ..self.clone() }
    }

    /// Writes a picture of `width` × `height`: under a temporary name first, so that
    /// nothing unfinished ever bears the final one. Codes are taken as encoded by this
    /// output's transfer; floats are encoded where the file holds codes.
    ///
    /// # Errors
    /// When the system refuses, or the pixels are codes and the file holds floats or
    /// codes of another depth, or they are not `width` × `height`.
    pub fn write(&self, width: u32, height: u32, pixels: PixelsRef<'_>) -> Result<(), OutputError> {
        write_whole(&self.path, &self.target, |to| self.encode(width, height, pixels, to))
    }

    /// The same at another place.
    ///
    /// # Errors
    /// As [`Self::plan`].
    pub fn at(&self, path: &Path) -> Result<Self, OutputError> {
        Self::plan(path, self.depth, self.transfer)
    }

    /// Takes room on the disk for a picture of `width` × `height`, as much as it may need at most.
    ///
    /// # Errors
    /// [`OutputError::NoRoom`] where the disk has not so much, [`OutputError::Folder`] where it takes no files.
    pub fn reserve(&self, width: u32, height: u32) -> Result<Reserved, OutputError> {
        let folder = || self.target.parent().unwrap_or(Path::new("")).to_path_buf();
        let mut temporary = Temporary::beside(&self.target).map_err(|e| OutputError::Folder(folder(), e))?;
        let bytes = self.bytes_at_most(width, height);
        match temporary.reserve(bytes) {
            Err(e) if is_no_room(&e) => Err(OutputError::NoRoom(self.path.clone(), bytes, e)),
            // Elsewhere it is found out when it is written.
            _ => Ok(Reserved(temporary)),
        }
    }

    /// Bytes of a file of `width` × `height` pixels, where nothing in it can be compressed.
    fn bytes_at_most(&self, width: u32, height: u32) -> u64 {
        let component = match (self.kind.is_float(), self.depth) {
            (true, _) => 4,
            (false, Depth::Eight) => 1,
            (false, Depth::Sixteen) => 2,
        };
        let raw = 3 * component * u64::from(width) * u64::from(height);
        let more = match self.kind {
            Kind::Ppm | Kind::Pfm => 64,
            // A byte a row for its filter; five for each stored block.
            Kind::Png => u64::from(height) + raw / 1000 + 4096,
            // Tables and heads of blocks.
            Kind::Exr => 64 * u64::from(height) + raw / 1000 + 65_536,
        };
        raw + more
    }

    /// As [`Self::write`], into room that was reserved, be it for this output or another one in its folder. With
    /// `durable` the file is on the disk before it bears its name.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn write_reserved(
        &self,
        room: Reserved,
        (width, height): (u32, u32),
        pixels: PixelsRef<'_>,
        durable: bool,
    ) -> Result<(), OutputError> {
        fill(room.0, &self.path, &self.target, |to| self.encode(width, height, pixels, to), durable)
    }

    /// As [`Self::write`], of pixels that are read a few rows at a time.
    ///
    /// # Errors
    /// As [`Self::write`], or when the pixels cannot be read.
    pub fn write_rows(&self, size: (u32, u32), pixels: &dyn Rows) -> Result<(), OutputError> {
        let form = (self.kind, self.depth, self.transfer);
        write_whole(&self.path, &self.target, |to| rows::write(to, size, form, pixels))
    }

    /// As [`Self::write_reserved`], of pixels that are read a few rows at a time.
    ///
    /// # Errors
    /// As [`Self::write_rows`].
    pub fn write_rows_reserved(
        &self,
        room: Reserved,
        size: (u32, u32),
        pixels: &dyn Rows,
        durable: bool,
    ) -> Result<(), OutputError> {
        let form = (self.kind, self.depth, self.transfer);
        fill(room.0, &self.path, &self.target, |to| rows::write(to, size, form, pixels), durable)
    }

    /// As [`Self::write`], but pixels that are not `present` are transparent where the file can say so.
    ///
    /// # Errors
    /// As [`Self::write`], or when `present` are not as many as pixels.
    pub fn write_part(
        &self,
        (width, height): (u32, u32),
        pixels: PixelsRef<'_>,
        present: &[bool],
    ) -> Result<(), OutputError> {
        write_whole(&self.path, &self.target, |to| match self.kind {
            Kind::Png if present.contains(&false) => {
                let codes = self.with_alpha(pixels, present)?;
                png::write(to, (width, height), (self.depth, true), &codes, self.transfer)
            }
            _ => self.encode(width, height, pixels, to),
        })
    }

    /// Big-endian codes of the depth of this output, each pixel followed by whether it is there.
    fn with_alpha(&self, pixels: PixelsRef<'_>, present: &[bool]) -> io::Result<Vec<u8>> {
        if pixels.len() != present.len() {
            return Err(io::Error::other("the pixels are not as many as said"));
        }
        let alpha = |there: &bool| if *there { u16::MAX } else { 0 };
        Ok(match (self.depth, pixels) {
            (Depth::Eight, PixelsRef::F32(p)) => {
                return self.with_alpha(PixelsRef::Rgb8(&encode::to_bytes(self.transfer, p)), present);
            }
            (Depth::Sixteen, PixelsRef::F32(p)) => {
                return self.with_alpha(PixelsRef::Rgb16(&encode::to_words(self.transfer, p)), present);
            }
            (Depth::Eight, PixelsRef::Rgb8(p)) => {
                p.iter().zip(present).flat_map(|(&[r, g, b], there)| [r, g, b, alpha(there) as u8]).collect()
            }
            (Depth::Sixteen, PixelsRef::Rgb16(p)) => p
                .iter()
                .zip(present)
                .flat_map(|(&[r, g, b], there)| [r, g, b, alpha(there)].map(u16::to_be_bytes))
                .flatten()
                .collect(),
            _ => return Err(io::Error::other("the pixels are not of the depth that the file holds")),
        })
    }

    fn encode(&self, width: u32, height: u32, pixels: PixelsRef<'_>, to: &mut impl Write) -> io::Result<()> {
        if pixels.len() as u64 != u64::from(width) * u64::from(height) || pixels.is_empty() {
            return Err(io::Error::other(format!("{} pixels are no picture of {width}x{height}", pixels.len())));
        }
        match (self.kind, self.depth, pixels) {
            (Kind::Pfm, _, PixelsRef::F32(p)) => netpbm::write_pfm(to, width, height, p),
            (Kind::Exr, _, PixelsRef::F32(p)) => exr::write(to, width, height, p),
            (Kind::Png | Kind::Ppm, Depth::Eight, PixelsRef::F32(p)) => {
                let codes = encode::to_bytes(self.transfer, p);
                self.encode(width, height, PixelsRef::Rgb8(&codes), to)
            }
            (Kind::Png | Kind::Ppm, Depth::Sixteen, PixelsRef::F32(p)) => {
                let codes = encode::to_words(self.transfer, p);
                self.encode(width, height, PixelsRef::Rgb16(&codes), to)
            }
            (Kind::Png, Depth::Eight, PixelsRef::Rgb8(p)) => {
                png::write(to, (width, height), (Depth::Eight, false), p.as_flattened(), self.transfer)
            }
            (Kind::Ppm, Depth::Eight, PixelsRef::Rgb8(p)) => {
                netpbm::write_ppm(to, width, height, Depth::Eight, p.as_flattened())
            }
            (kind, Depth::Sixteen, PixelsRef::Rgb16(p)) if !kind.is_float() => {
                let bytes: Vec<u8> = p.as_flattened().iter().flat_map(|w| w.to_be_bytes()).collect();
                if kind == Kind::Png {
                    png::write(to, (width, height), (Depth::Sixteen, false), &bytes, self.transfer)
                } else {
                    netpbm::write_ppm(to, width, height, Depth::Sixteen, &bytes)
                }
            }
            _ => Err(io::Error::other("the pixels are not of the depth that the file holds")),
        }
    }
}
