//! Portable network graphics.

use std::io::{self, BufRead, Seek, Write};

use png::{
    BitDepth, ColorType, Compression, Decoder, Encoder, Filter, Limits, ScaledFloat, SrgbRenderingIntent, Writer,
};
use png::{DecodingError, EncodingError, Transformations};

use super::Depth;
use super::read::{ReadError, Stored};
use crate::film::image::Image;
use crate::settings::Transfer;

/// Big-endian RGB codes, each followed by alpha if there is any, with what they mean declared: sRGB, or a gamma of 1.
pub(super) fn write(
    to: &mut impl Write,
    (width, height): (u32, u32),
    (depth, alpha): (Depth, bool),
    codes: &[u8],
    transfer: Transfer,
) -> io::Result<()> {
    let mut writer = begin(to, (width, height), (depth, alpha), transfer)?;
    writer.write_image_data(codes).map_err(wrap)?;
    writer.finish().map_err(wrap)
}

/// As [`write`], of RGB codes that `codes` writes one after another.
pub(super) fn write_rows<W: Write>(
    to: &mut W,
    size: (u32, u32),
    depth: Depth,
    transfer: Transfer,
    codes: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let mut writer = begin(to, size, (depth, false), transfer)?;
    let mut stream = writer.stream_writer_with_size(1 << 18).map_err(wrap)?;
    codes(&mut stream)?;
    stream.finish().map_err(wrap)?;
    writer.finish().map_err(wrap)
}

fn wrap(e: EncodingError) -> io::Error {
    match e {
        EncodingError::IoError(e) => e,
        e => io::Error::other(e),
    }
}

fn begin<W: Write>(
    to: W,
    (width, height): (u32, u32),
    (depth, alpha): (Depth, bool),
    transfer: Transfer,
) -> io::Result<Writer<W>> {
    let mut encoder = Encoder::new(to, width, height);
    encoder.set_color(if alpha { ColorType::Rgba } else { ColorType::Rgb });
    encoder.set_depth(if depth == Depth::Eight { BitDepth::Eight } else { BitDepth::Sixteen });
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Paeth);
    match transfer {
        Transfer::Srgb => encoder.set_source_srgb(SrgbRenderingIntent::Perceptual),
        Transfer::Linear => encoder.set_source_gamma(ScaledFloat::from_scaled(100_000)),
    }
    encoder.write_header().map_err(wrap)
}

/// Reads any PNG; grey becomes three equal components, alpha is left out.
pub(super) fn read(from: impl BufRead + Seek) -> Result<Stored, ReadError> {
    let wrap = |e| match e {
        DecodingError::IoError(e) if e.kind() == io::ErrorKind::UnexpectedEof => {
            ReadError::Broken("it is truncated".into())
        }
        DecodingError::IoError(e) => ReadError::Io(e),
        e => ReadError::Broken(e.to_string()),
    };
    let mut decoder = Decoder::new_with_limits(from, Limits { bytes: 1 << 30 });
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(wrap)?;
    let (width, height) = (reader.info().width, reader.info().height);
    super::read::pixel_count(width, height)?;
    let gamma = reader.info().gamma().map(ScaledFloat::into_scaled);
    let transfer =
        if reader.info().srgb.is_none() && gamma == Some(100_000) { Transfer::Linear } else { Transfer::Srgb };
    let size = reader.output_buffer_size().ok_or(ReadError::Size(width, height))?;
    let mut bytes = vec![0; size];
    let frame = reader.next_frame(&mut bytes).map_err(wrap)?;
    bytes.truncate(frame.buffer_size());
    let (color, depth) = reader.output_color_type();
    let channels = color.samples();
    let values: Vec<f32> = if depth == BitDepth::Sixteen {
        bytes.as_chunks::<2>().0.iter().map(|&b| f32::from(u16::from_be_bytes(b)) / 65535.0).collect()
    } else {
        bytes.iter().map(|&b| f32::from(b) / 255.0).collect()
    };
    let pixels =
        values.chunks_exact(channels).map(|p| if channels < 3 { [p[0]; 3] } else { [p[0], p[1], p[2]] }).collect();
    let image = Image::new(width, height, pixels).ok_or(ReadError::Size(width, height))?;
    Ok(Stored { image, transfer: Some(transfer) })
}
