//! OpenEXR.

use std::io::{self, BufRead, Cursor, Seek, Write};

use exr::prelude::*;

use super::read::ReadError;
use crate::film::image::Image as Linear;

/// Linear RGB of 32-bit floats in one layer.
pub(super) fn write(to: &mut impl Write, width: u32, height: u32, pixels: &[[f32; 3]]) -> io::Result<()> {
    // The format's table of offsets comes first and is filled in last.
    let mut bytes = Cursor::new(Vec::with_capacity(12 * pixels.len() + 4096));
    write_pixels(&mut bytes, width, height, |x, y| pixels[y * width as usize + x])?;
    to.write_all(bytes.get_ref())
}

/// As [`write`], of pixels that are asked for by column and row, rows from the top.
pub(super) fn write_pixels(
    to: &mut (impl Write + Seek),
    width: u32,
    height: u32,
    pixel: impl Fn(usize, usize) -> [f32; 3] + Sync,
) -> io::Result<()> {
    let size = (width as usize, height as usize);
    let pixel = |at: Vec2<usize>| {
        let [r, g, b] = pixel(at.x(), at.y());
        (r, g, b)
    };
    let encoding =
        Encoding { compression: Compression::RLE, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new(size, LayerAttributes::default(), encoding, SpecificChannels::rgb(pixel));
    Image::from_layer(layer).write().non_parallel().to_buffered(to).map_err(|e| match e {
        Error::Io(e) => e,
        e => io::Error::other(e),
    })
}

/// Whether no layer has colours but one has luminance. Where there is neither, says what there is.
fn is_grey(metadata: &MetaData) -> std::result::Result<bool, ReadError> {
    let names: Vec<Vec<String>> =
        metadata.headers.iter().map(|h| h.channels.list.iter().map(|c| c.name.to_string()).collect()).collect();
    let has = |layer: &[String], wanted: &[&str]| wanted.iter().all(|w| layer.iter().any(|n| n == w));
    if names.iter().any(|layer| has(layer, &["R", "G", "B"])) {
        return Ok(false);
    }
    if names.iter().any(|layer| has(layer, &["Y"]) && !has(layer, &["RY"]) && !has(layer, &["BY"])) {
        return Ok(true);
    }
    let all = names.concat().join(", ").escape_debug().to_string();
    Err(ReadError::Broken(format!("it has neither channels R, G and B nor grey alone (Y); it has {all}")))
}

/// Reads the first layer with luminance as grey.
fn read_grey(from: impl BufRead + Seek) -> std::result::Result<Option<Linear>, Error> {
    let image = exr::image::read::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("Y")
        .collect_pixels(
            |size, _| (size.width(), vec![[0.0_f32; 3]; size.area()]),
            |(width, pixels): &mut (usize, Vec<[f32; 3]>), at, (y,): (f32,)| {
                pixels[at.y() * *width + at.x()] = [y; 3];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(from)?;
    let Vec2(width, height) = image.layer_data.size;
    Ok(Linear::new(width as u32, height as u32, image.layer_data.channel_data.pixels.1))
}

/// Reads the first layer with red, green and blue, or the first with grey.
pub(super) fn read(from: impl BufRead + Seek) -> std::result::Result<Linear, ReadError> {
    let wrap = |e| match e {
        Error::Io(e) if e.kind() == io::ErrorKind::UnexpectedEof => ReadError::Broken("it is truncated".into()),
        Error::Io(e) => ReadError::Io(e),
        e => ReadError::Broken(e.to_string()),
    };
    let mut from = from;
    let start = from.stream_position().map_err(ReadError::Io)?;
    let metadata = MetaData::read_from_buffered(&mut from, false).map_err(wrap)?;
    for header in &metadata.headers {
        let Vec2(w, h) = header.layer_size;
        super::read::pixel_count(u32::try_from(w).unwrap_or(u32::MAX), u32::try_from(h).unwrap_or(u32::MAX))?;
    }
    from.seek(io::SeekFrom::Start(start)).map_err(ReadError::Io)?;
    if is_grey(&metadata)? {
        return read_grey(from).map_err(wrap)?.ok_or(ReadError::Size(0, 0));
    }
    let image = exr::image::read::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| (size.width(), vec![[0.0_f32; 3]; size.area()]),
            |(width, pixels): &mut (usize, Vec<[f32; 3]>), at, (r, g, b): (f32, f32, f32)| {
                pixels[at.y() * *width + at.x()] = [r, g, b];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(from)
        .map_err(wrap)?;
    let Vec2(width, height) = image.layer_data.size;
    let (width, height) = (width as u32, height as u32);
    Linear::new(width, height, image.layer_data.channel_data.pixels.1).ok_or(ReadError::Size(width, height))
}
