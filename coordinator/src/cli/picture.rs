//! `coordinator picture`: what a journal holds, as a picture.

use std::path::Path;

use coordinator::Pixels;
use coordinator::journal::Partial;
use tessera_core::film::PixelsRef;
use tessera_core::film::file::{Depth, Output};
use tessera_core::film::transfer::to_linear;

use super::args::Picture;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::files::Files;

/// Writes the picture as far as it is.
pub(crate) fn run(raw: &Picture, console: &Console) -> Result<Exit, Failure> {
    let mut files = Files::default();
    files.reads("the journal", &raw.journal)?;
    files.writes("the picture", &raw.output)?;
    let partial = Partial::read(&raw.journal).map_err(|e| Failure::new(Exit::Failed, e))?;
    write(partial, &raw.output, raw.bits.as_deref(), raw.missing, console)
}

/// Writes `partial` to `output`; what is `missing` has that colour, or is transparent.
pub(super) fn write(
    mut partial: Partial,
    output: &Path,
    bits: Option<&str>,
    missing: Option<[u8; 3]>,
    console: &Console,
) -> Result<Exit, Failure> {
    let depth = match (&partial.image, bits) {
        (Pixels::Rgb16(_), None) | (_, Some("16")) => Depth::Sixteen,
        _ => Depth::Eight,
    };
    let output = Output::plan(output, depth, partial.transfer).map_err(Failure::usage)?;
    let held = match &partial.image {
        Pixels::F32(_) => None,
        Pixels::Rgb8(_) => Some(Depth::Eight),
        Pixels::Rgb16(_) => Some(Depth::Sixteen),
    };
    if let Some(held) = held.filter(|held| output.depth() != Some(*held)) {
        return Err(Failure::usage(format!(
            "what is kept are pixels of {0} bits: write a .png or .ppm of {0} bits",
            held.bits()
        )));
    }
    if let Some(at) = partial.damaged {
        console.warning(&format!("the journal is damaged at byte {at}: what stood behind that is missing"));
    }
    if let Some(missing) = missing {
        fill(&mut partial, missing);
    }
    let (width, height) = (partial.region.width(), partial.region.height());
    let pixels = PixelsRef::from(&partial.image);
    let whole = partial.present.iter().all(|&p| p);
    let written = match missing {
        Some(_) => output.write(width, height, pixels),
        None if whole => output.write(width, height, pixels),
        None => output.write_part((width, height), pixels, &partial.present),
    };
    written.map_err(|e| Failure::new(Exit::Failed, e))?;
    let (path, percent) = (output.path().display(), (100.0 * partial.share()).floor());
    console.say(&format!("{path}: {width}x{height} pixels, {percent} % of it"));
    Ok(Exit::Done)
}

/// Gives what is missing this colour: encoded as the file's, so linear in one of floats.
fn fill(partial: &mut Partial, colour: [u8; 3]) {
    let missing = |i: &usize| !partial.present[*i];
    let places = (0..partial.present.len()).filter(missing);
    match &mut partial.image {
        Pixels::Rgb8(p) => places.for_each(|i| p[i] = colour),
        Pixels::Rgb16(p) => places.for_each(|i| p[i] = colour.map(|c| u16::from(c) * 257)),
        Pixels::F32(p) => {
            let linear = colour.map(|c| to_linear(partial.transfer, f64::from(c) / 255.0) as f32);
            places.for_each(|i| p[i] = linear);
        }
    }
}
