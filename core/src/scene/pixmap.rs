//! Portable pixmaps (P3, P6): files and bytes into [`Texture`]s.
//!
//! The raster is read by the `image` crate. The header is read here, because of
//! what that decoder does with one: it takes a height of 0, spends seconds on
//! leading zeros, reads on into the raster behind `255#comment`, and *scales*
//! samples where maxval is neither 255 nor 65535, which would lose both the file's
//! own numbers and the sight of samples above maxval. It is handed a header that
//! needs no scaling instead, and nothing is allocated before the file is known to
//! be long enough to fill it.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use image::ImageDecoder;
use image::codecs::pnm::PnmDecoder;

use super::{Texture, TextureError};

/// The longest header, comments included, in bytes.
const MAX_HEADER: u64 = 1 << 20;
/// Digits a header's number may have, leading zeros included.
const MAX_DIGITS: usize = 20;

/// Why a file is not a picture.
#[derive(Debug, thiserror::Error)]
pub enum PixmapError {
    /// There is no such file.
    #[error("there is no such file")]
    Missing,
    /// A directory, FIFO, device or socket.
    #[error("it is {0}, not a regular file")]
    NotAFile(&'static str),
    /// The system refused.
    #[error("it cannot be read: {0}")]
    Io(io::Error),
    /// The file does not begin with P3 or P6.
    #[error("it is not a portable pixmap: it begins with {0}, not with P3 or P6")]
    Magic(String),
    /// The header is not three numbers.
    #[error("its header is broken: {0}")]
    Header(String),
    /// Width or height 0, or more pixels than a picture may have.
    #[error(
        "its size of {0}x{1} pixels is {why}",
        why = if *.0 == 0 || *.1 == 0 { "empty" } else { "above the limit of 89,478,485 pixels" }
    )]
    Size(u64, u64),
    /// maxval outside 1..=65535.
    #[error("its largest value (maxval) is {0}; it must be 1 to 65535")]
    Maxval(u64),
    /// Fewer samples than the header promises.
    #[error("it is truncated: {width}x{height} pixels were promised, the file ends before the last")]
    Truncated {
        /// Pixels across, as promised.
        width: u32,
        /// Pixels down, as promised.
        height: u32,
    },
    /// A sample above maxval.
    #[error(
        "the pixel in column {column}, row {row} (from 0) has a sample of {value}, above the largest value {maxval}"
    )]
    Sample {
        /// Column of the first such pixel.
        column: usize,
        /// Row of the first such pixel.
        row: usize,
        /// The sample.
        value: u16,
        /// The largest allowed.
        maxval: u16,
    },
    /// Something in the raster that is not a number.
    #[error("its pixels are broken: {0}")]
    Raster(String),
}

/// Reads the pixmap at `path`.
///
/// # Errors
/// When it is no regular file (nothing else is opened, so that a FIFO cannot
/// block), cannot be read, or is no whole pixmap.
pub fn load(path: &Path) -> Result<Texture, PixmapError> {
    let refuse = |m: &std::fs::Metadata| (!m.is_file()).then(|| PixmapError::NotAFile(kind(m)));
    let wrap =
        |e: io::Error| if e.kind() == io::ErrorKind::NotFound { PixmapError::Missing } else { PixmapError::Io(e) };
    if let Some(e) = refuse(&std::fs::metadata(path).map_err(wrap)?) {
        return Err(e);
    }
    let file = File::open(path).map_err(wrap)?;
    // Again on what was opened: the name may point elsewhere by now.
    let metadata = file.metadata().map_err(wrap)?;
    if let Some(e) = refuse(&metadata) {
        return Err(e);
    }
    read(BufReader::with_capacity(1 << 16, file), metadata.len())
}

/// Reads a pixmap from its `bytes`; what follows the last pixel is ignored, as
/// other readers do, since a file may hold several pictures.
///
/// # Errors
/// When they are no whole pixmap.
pub fn decode(bytes: &[u8]) -> Result<Texture, PixmapError> {
    read(bytes, bytes.len() as u64)
}

/// What a directory entry is that is not a regular file.
fn kind(metadata: &std::fs::Metadata) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        let t = metadata.file_type();
        if t.is_fifo() {
            return "a FIFO (named pipe)";
        } else if t.is_socket() {
            return "a socket";
        } else if t.is_char_device() || t.is_block_device() {
            return "a device";
        }
    }
    if metadata.is_dir() { "a directory" } else { "something else" }
}

/// Counts what is taken from a reader.
struct Counted<R> {
    inner: R,
    taken: u64,
    /// What ended the last number.
    last: Option<u8>,
}

impl<R: BufRead> Counted<R> {
    /// The next byte, or `None` at the end.
    fn byte(&mut self) -> Result<Option<u8>, PixmapError> {
        if self.taken == MAX_HEADER {
            return Err(PixmapError::Header(format!("it does not end within {MAX_HEADER} bytes")));
        }
        let mut byte = [0];
        loop {
            match self.inner.read(&mut byte) {
                Ok(0) => return Ok(None),
                Ok(_) => {
                    self.taken += 1;
                    return Ok(Some(byte[0]));
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(PixmapError::Io(e)),
            }
        }
    }

    /// The next byte of a header: a comment reads as the end of its line.
    fn header_byte(&mut self) -> Result<Option<u8>, PixmapError> {
        let mut byte = self.byte()?;
        if byte == Some(b'#') {
            while !matches!(byte, None | Some(b'\n' | b'\r')) {
                byte = self.byte()?;
            }
        }
        Ok(byte)
    }

    /// Whether a line's end of two bytes (CR, LF) was cut in half by taking only the first: the second is there, and
    /// one byte more than the raster needs.
    fn is_within_a_line_end(&mut self, last: Option<u8>, spare: bool) -> Result<bool, PixmapError> {
        Ok(last == Some(b'\r') && spare && self.inner.fill_buf().map_err(PixmapError::Io)?.first() == Some(&b'\n'))
    }

    /// A number, and the one white-space byte that ends it.
    fn number(&mut self, what: &str) -> Result<u64, PixmapError> {
        let ends = || PixmapError::Header(format!("it ends before its {what}"));
        let mut byte = self.header_byte()?.ok_or_else(ends)?;
        while is_space(byte) {
            byte = self.header_byte()?.ok_or_else(ends)?;
        }
        let (mut value, mut digits) = (0_u64, 0);
        loop {
            if !byte.is_ascii_digit() {
                return Err(PixmapError::Header(format!("{} stands where its {what} should", show(&[byte]))));
            }
            digits += 1;
            if digits > MAX_DIGITS {
                return Err(PixmapError::Header(format!("its {what} has more than {MAX_DIGITS} digits")));
            }
            value = value.saturating_mul(10).saturating_add(u64::from(byte - b'0'));
            let next = self.header_byte()?;
            self.last = next;
            match next {
                None => return Ok(value),
                Some(b) if is_space(b) => return Ok(value),
                Some(b) => byte = b,
            }
        }
    }
}

fn is_space(byte: u8) -> bool {
    matches!(byte, b'\t' | b'\n' | 0x0b | 0x0c | b'\r' | b' ')
}

/// Bytes as a person reads them.
fn show(bytes: &[u8]) -> String {
    if bytes.is_empty() { "nothing".into() } else { format!("'{}'", bytes.escape_ascii()) }
}

/// Width and height, and how many samples that is.
fn size<R: BufRead>(input: &mut Counted<R>) -> Result<(u32, u32, u64), PixmapError> {
    let (w, h) = (input.number("width")?, input.number("height")?);
    let samples = w.checked_mul(h).and_then(|n| n.checked_mul(3)).filter(|&n| n <= Texture::MAX_SAMPLES as u64);
    let (Some(samples), Ok(width), Ok(height)) = (samples, u32::try_from(w), u32::try_from(h)) else {
        return Err(PixmapError::Size(w, h));
    };
    if samples == 0 {
        return Err(PixmapError::Size(w, h));
    }
    Ok((width, height, samples))
}

fn read<R: BufRead>(reader: R, length: u64) -> Result<Texture, PixmapError> {
    let mut input = Counted { inner: reader, taken: 0, last: None };
    let mut magic = Vec::with_capacity(2);
    while magic.len() < 2 {
        match input.byte()? {
            Some(b) => magic.push(b),
            None => break,
        }
    }
    let plain = match &magic[..] {
        b"P3" => true,
        b"P6" => false,
        other => return Err(PixmapError::Magic(show(other))),
    };
    let (width, height, samples) = size(&mut input)?;
    let maxval = input.number("largest value")?;
    let maxval = u16::try_from(maxval).ok().filter(|&m| m > 0).ok_or(PixmapError::Maxval(maxval))?;

    // The file must be able to hold the raster before memory is taken for it: a
    // plain sample is a digit and what parts it from the next.
    let wide = maxval > 255;
    let least = if plain { 2 * samples - 1 } else { samples * if wide { 2 } else { 1 } };
    if length.saturating_sub(input.taken) < least {
        return Err(PixmapError::Truncated { width, height });
    }
    let spare = length.saturating_sub(input.taken) > least;
    if !plain && input.is_within_a_line_end(input.last, spare)? {
        input.byte()?;
    }

    let failed = |e: image::ImageError| match e {
        image::ImageError::IoError(e) if e.kind() == io::ErrorKind::UnexpectedEof => {
            PixmapError::Truncated { width, height }
        }
        image::ImageError::IoError(e) => PixmapError::Io(e),
        e if e.to_string().contains("Not enough data") => PixmapError::Truncated { width, height },
        e => PixmapError::Raster(e.to_string()),
    };
    let (kind, full) = match (plain, wide) {
        (true, _) => ("P3", 65535),
        (false, true) => ("P6", 65535),
        (false, false) => ("P6", 255),
    };
    let header = format!("{kind} {width} {height} {full}\n");
    let decode = |out: &mut [u8]| {
        let raster: &mut dyn Read =
            if plain { &mut WithoutComments { inner: input.inner, within: false } } else { &mut { input.inner } };
        PnmDecoder::new(header.as_bytes().chain(raster)).and_then(|d| d.read_image(out)).map_err(failed)
    };
    let samples = samples as usize;
    let above = |index: usize, value: u16| {
        let pixel = index / 3;
        PixmapError::Sample { column: pixel % width as usize, row: pixel / width as usize, value, maxval }
    };
    let unfit = |e: TextureError| PixmapError::Raster(e.to_string());
    if full == 255 {
        let mut bytes = vec![0_u8; samples];
        decode(&mut bytes)?;
        if let Some(i) = bytes.iter().position(|&b| u16::from(b) > maxval) {
            return Err(above(i, bytes[i].into()));
        }
        Texture::from_bytes(width, height, maxval as u8, bytes).map_err(unfit)
    } else {
        let mut native = vec![0_u8; 2 * samples];
        decode(&mut native)?;
        let words = native.as_chunks::<2>().0.iter().map(|&b| u16::from_ne_bytes(b));
        if let Some((i, v)) = words.clone().enumerate().find(|&(_, v)| v > maxval) {
            return Err(above(i, v));
        }
        if wide {
            Texture::from_words(width, height, maxval, words.collect()).map_err(unfit)
        } else {
            Texture::from_bytes(width, height, maxval as u8, words.map(|v| v as u8).collect()).map_err(unfit)
        }
    }
}

/// A plain raster with its comments blanked: the decoder knows none there.
struct WithoutComments<R> {
    inner: R,
    within: bool,
}

impl<R: Read> Read for WithoutComments<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let n = self.inner.read(out)?;
        for b in &mut out[..n] {
            self.within = (self.within && !matches!(b, b'\n' | b'\r')) || *b == b'#';
            if self.within {
                *b = b' ';
            }
        }
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_end_of_two_bytes_before_the_raster_is_one() {
        let picture = decode(b"P6\r\n1 1\r\n255\r\nabc").unwrap();
        assert_eq!([0, 1, 2].map(|i| picture.sample(i)), [97, 98, 99]);
        // Where the raster would lack a byte, it is the raster's.
        let picture = decode(b"P6 1 1 255\r\nab").unwrap();
        assert_eq!([0, 1, 2].map(|i| picture.sample(i)), [10, 97, 98]);
    }

    fn error(bytes: &[u8]) -> String {
        decode(bytes).unwrap_err().to_string()
    }

    #[test]
    fn samples_are_kept_as_written_at_any_maxval() {
        let p = decode(b"P6 2 1 100\n\x00\x01\x32\x64\x63\x02").unwrap();
        assert_eq!((p.width(), p.height(), p.maxval()), (2, 1, 100));
        assert_eq!(p.bytes().unwrap(), [0, 1, 50, 100, 99, 2]);
        let p = decode(b"P6 1 1 1000\n\x00\x01\x03\xe8\x01\x00").unwrap();
        assert_eq!(p.words().unwrap(), [1, 1000, 256]);
        let p = decode(b"P3 1 2 7\n0 1 2\n7 06 5").unwrap();
        assert_eq!((p.height(), p.bytes().unwrap()), (2, &[0, 1, 2, 7, 6, 5][..]));
        let p = decode(b"P3 1 1 65535 65535 0 256 ").unwrap();
        assert_eq!(p.words().unwrap(), [65535, 0, 256]);
        assert_eq!(decode(b"P6 1 1 1\n\x00\x01\x01").unwrap().bytes().unwrap(), [0, 1, 1]);
    }

    #[test]
    fn comments_end_at_their_line_in_headers_and_plain_rasters() {
        let p = decode(b"P6#one\n# two\n1#three\r1 # four\n255#five\nabc").unwrap();
        assert_eq!(p.bytes().unwrap(), b"abc");
        // Behind the one white-space byte the raster begins, whatever it looks like.
        assert_eq!(decode(b"P6 1 1 255\n#ab").unwrap().bytes().unwrap(), b"#ab");
        let p = decode(b"P3 1 1 9 # raster\n1#c 5\n2 # 7\r3").unwrap();
        assert_eq!(p.bytes().unwrap(), [1, 2, 3]);
    }

    #[test]
    fn what_follows_the_last_pixel_is_ignored() {
        assert_eq!(decode(b"P6 1 1 255\nabcP6 1 1 255\nxyz").unwrap().bytes().unwrap(), b"abc");
    }

    #[test]
    fn every_fault_says_why() {
        assert!(error(b"").contains("begins with nothing"));
        assert!(error(b"\x89PNG").contains(r"begins with '\x89P'"));
        assert!(error(b"P5 1 1 255\n").contains("'P5', not with P3 or P6"));
        assert!(error(b"P6 1").contains("ends before its height"));
        assert!(error(b"P6 1 -1 255\n").contains("'-' stands where its height"));
        assert!(error(b"P6 0 1 255\n").contains("0x1 pixels is empty"));
        assert!(error(b"P6 4 0 255\n").contains("4x0 pixels is empty"));
        assert!(error(b"P6 100000 100000 255\n").contains("100000x100000 pixels is above the limit"));
        assert!(error(b"P6 18446744073709551615 3 255\n").contains("above the limit"));
        assert!(error(b"P6 1 1 0\nabc").contains("maxval) is 0"));
        assert!(error(b"P6 1 1 65536\nabcdef").contains("maxval) is 65536"));
        assert!(error(b"P6 1 2 255\nabcde").contains("truncated: 1x2"));
        assert!(error(b"P6 1 1 256\nabcde").contains("truncated"));
        assert!(error(b"P3 1 2 255 1 2 3 4 5       ").contains("truncated"));
        assert!(error(b"P6 2 1 9\n\x01\x02\x03\x01\x0a\x03").contains("column 1, row 0 (from 0) has a sample of 10"));
        assert!(error(b"P3 1 2 9 1 2 3 1 1000 1").contains("column 0, row 1 (from 0) has a sample of 1000"));
        assert!(error(b"P3 1 1 255 1 2 x ").contains("pixels are broken"));
        assert!(error(b"P3 1 1 255 1 2 99999 ").contains("pixels are broken"));
    }

    #[test]
    fn limits_hold_before_memory_and_time_are_spent() {
        // A gigabyte promised by a few bytes.
        assert!(error(b"P6 8000 8000 65535\nabc").contains("truncated"));
        let mut zeros = b"P6 ".to_vec();
        zeros.resize(50 << 20, b'0');
        assert!(error(&zeros).contains("width has more than 20 digits"));
        let mut comment = b"P6 #".to_vec();
        comment.resize(4 << 20, b'x');
        assert!(error(&comment).contains("does not end within"));
        assert_eq!(decode(b"P6 01 0001 00255\nabc").unwrap().bytes().unwrap(), b"abc");
    }

    #[cfg(unix)]
    #[test]
    fn only_regular_files_are_opened() {
        let folder = tempfile::tempdir().unwrap();
        let why = |name: &str| load(&folder.path().join(name)).unwrap_err().to_string();
        assert!(why("nothing.ppm").contains("no such file"));
        std::fs::create_dir(folder.path().join("folder")).unwrap();
        assert!(why("folder").contains("a directory"));
        let fifo = folder.path().join("fifo");
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        assert!(why("fifo").contains("a FIFO"));
        std::fs::write(folder.path().join("file.ppm"), b"P6 1 1 255\nabc").unwrap();
        assert_eq!(load(&folder.path().join("file.ppm")).unwrap().bytes().unwrap(), b"abc");
    }
}
