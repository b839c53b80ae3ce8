//! Portable pixmaps and float maps.

use std::io::{self, BufRead, Write};

use super::Depth;
use super::read::ReadError;
use crate::film::image::Image;

/// A P6 pixmap of big-endian codes.
pub(super) fn write_ppm(to: &mut impl Write, width: u32, height: u32, depth: Depth, codes: &[u8]) -> io::Result<()> {
    let maxval = (1_u32 << depth.bits()) - 1;
    write!(to, "P6\n{width} {height}\n{maxval}\n")?;
    to.write_all(codes)
}

/// A little-endian RGB float map: rows run from the bottom.
pub(super) fn write_pfm(to: &mut impl Write, width: u32, height: u32, pixels: &[[f32; 3]]) -> io::Result<()> {
    write!(to, "PF\n{width} {height}\n-1.0\n")?;
    write_floats(to, width, pixels)
}

/// Rows of a float map, the last one first.
pub(super) fn write_floats(to: &mut impl Write, width: u32, pixels: &[[f32; 3]]) -> io::Result<()> {
    for row in pixels.rchunks_exact(width as usize) {
        let bytes: Vec<u8> = row.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        to.write_all(&bytes)?;
    }
    Ok(())
}

/// Reads a float map, grey (Pf) or coloured (PF), of either byte order.
pub(super) fn read_pfm(mut from: impl BufRead, length: u64) -> Result<Image, ReadError> {
    let broken = |what: &str| ReadError::Broken(format!("its PFM header is broken: {what}"));
    let mut header_length = 0;
    let mut last = 0;
    let mut word = |what: &str| -> Result<String, ReadError> {
        let mut text = Vec::new();
        loop {
            let mut byte = [0];
            if io::Read::read(&mut from, &mut byte).map_err(ReadError::Io)? == 0 {
                return Err(broken(&format!("it ends before its {what}")));
            }
            header_length += 1;
            match byte[0] {
                b if b.is_ascii_whitespace() && text.is_empty() => {}
                b if b.is_ascii_whitespace() => {
                    last = b;
                    return Ok(String::from_utf8_lossy(&text).into_owned());
                }
                b => text.push(b),
            }
            if header_length > 1024 {
                return Err(broken("it is too long"));
            }
        }
    };
    let components: u64 = match &*word("kind")? {
        "PF" => 3,
        "Pf" => 1,
        other => return Err(broken(&format!("it begins with '{}', not with PF or Pf", other.escape_debug()))),
    };
    let mut number = |what: &str| -> Result<u32, ReadError> {
        let text = word(what)?;
        text.parse().map_err(|_| broken(&format!("its {what} is '{}'", text.escape_debug())))
    };
    let (width, height) = (number("width")?, number("height")?);
    let scale = word("scale")?;
    let scale: f32 = scale.parse().map_err(|_| broken(&format!("its scale is '{}'", scale.escape_debug())))?;
    if scale == 0.0 || !scale.is_finite() {
        return Err(broken("its scale is not a number other than 0"));
    }
    let count = super::read::pixel_count(width, height)?;
    // A line's end of two bytes: one more than the floats take is there.
    let spare = length.saturating_sub(header_length) > count * components * 4;
    if last == b'\r' && spare && from.fill_buf().map_err(ReadError::Io)?.first() == Some(&b'\n') {
        from.consume(1);
        header_length += 1;
    }
    if length.saturating_sub(header_length) < count * components * 4 {
        return Err(ReadError::Broken(format!("it is truncated: {width}x{height} pixels were promised")));
    }
    let mut bytes = vec![0; (count * components * 4) as usize];
    from.read_exact(&mut bytes).map_err(ReadError::Io)?;
    let float = |b: [u8; 4]| if scale < 0.0 { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) };
    let row = width as usize * components as usize * 4;
    let pixels = bytes
        .rchunks_exact(row)
        .flat_map(|r| r.as_chunks::<4>().0.chunks_exact(components as usize))
        .map(|p| if let &[r, g, b] = p { [float(r), float(g), float(b)] } else { [float(p[0]); 3] })
        .collect();
    Image::new(width, height, pixels).ok_or(ReadError::Size(width, height))
}
