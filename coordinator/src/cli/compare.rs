//! `coordinator compare`: how far two pictures are apart.

use std::fmt::Write;
use std::path::Path;

use serde::Serialize;
use tessera_core::film::file::{self, Depth, Output, Stored};
use tessera_core::film::{Metrics, PixelsRef, differences};
use tessera_core::settings::Transfer;

use super::args::Compare;
use super::console::Console;
use super::exit::{Exit, Failure};
use super::files::Files;

/// Compares the pictures and says by how much they differ.
pub(crate) fn run(raw: &Compare, console: &Console) -> Result<Exit, Failure> {
    let mut files = Files::default();
    for path in [&raw.a, &raw.b] {
        files.reads("a picture to compare", path)?;
    }
    if let Some(path) = &raw.diff {
        files.writes("the picture of differences", path)?;
    }
    let diff = match &raw.diff {
        Some(path) => Some(Output::plan(path, Depth::Eight, Transfer::Srgb).map_err(Failure::usage)?),
        None => None,
    };
    if let Some(output) = diff.as_ref().filter(|o| o.kind().is_float()) {
        return Err(Failure::usage(format!(
            "'{}': a difference picture is a .png or .ppm file",
            output.path().display()
        )));
    }
    let (a, b) = (read(&raw.a)?, read(&raw.b)?);
    let transfer = raw.transfer.map_or_else(|| a.transfer.or(b.transfer).unwrap_or(Transfer::Linear), Transfer::from);
    let sizes = [&a, &b].map(|s| (s.image.width(), s.image.height()));
    if let [(aw, ah), (bw, bh)] = sizes
        && sizes[0] != sizes[1]
    {
        return Err(Failure::new(
            Exit::Failed,
            format!(
                "the pictures are of different sizes: '{}' has {aw}x{ah} pixels, '{}' {bw}x{bh}",
                raw.a.display(),
                raw.b.display()
            ),
        ));
    }
    // Codes cannot hold what is beyond [0, 1]: against them, neither can floats.
    let clamp = a.transfer.is_some() != b.transfer.is_some();
    let prepare = |s: Stored| {
        let image = s.in_transfer(transfer);
        if clamp { image.map(|x| x.clamp(0.0, 1.0)) } else { image }
    };
    let (a, b) = (prepare(a), prepare(b));
    let metrics = Metrics::measure(&a, &b);
    if let Some(output) = &diff {
        let picture = differences(&a, &b);
        output
            .write(picture.width, picture.height, PixelsRef::Rgb8(&picture.pixels))
            .map_err(|e| Failure::new(Exit::Failed, e))?;
    }
    let result = Comparison::new(raw, transfer, &metrics);
    if raw.json {
        let text = serde_json::to_string_pretty(&result).map_err(|e| Failure::new(Exit::Failed, e))?;
        console.out(&(text + "\n"))?;
    } else {
        console.out(&result.to_text(&metrics))?;
    }
    Ok(if result.within { Exit::Done } else { Exit::Failed })
}

fn read(path: &Path) -> Result<Stored, Failure> {
    file::read(path).map_err(|e| Failure::usage(format!("'{}' is no picture to compare: {e}", path.display())))
}

/// What is printed; errors are in 8-bit steps where they are not said to be shares.
#[derive(Debug, Serialize)]
struct Comparison {
    a: String,
    b: String,
    transfer: &'static str,
    rmse: f64,
    rmse_fraction: f64,
    /// `None` where the pictures are equal: JSON has no infinity.
    psnr: Option<f64>,
    largest: f64,
    largest_at: (u32, u32),
    share_beyond_255th: f64,
    share_beyond_510th: f64,
    ssim: f64,
    flip: f64,
    tolerance: f64,
    within: bool,
}

impl Comparison {
    fn new(raw: &Compare, transfer: Transfer, m: &Metrics) -> Self {
        Self {
            a: raw.a.display().to_string(),
            b: raw.b.display().to_string(),
            transfer: transfer.name(),
            rmse: m.rmse_steps(),
            rmse_fraction: m.rmse,
            psnr: m.psnr.is_finite().then_some(m.psnr),
            largest: 255.0 * m.largest,
            largest_at: m.largest_at,
            share_beyond_255th: m.beyond_255th,
            share_beyond_510th: m.beyond_510th,
            ssim: m.ssim,
            flip: m.flip,
            tolerance: raw.tolerance,
            within: m.rmse_steps() <= raw.tolerance,
        }
    }

    fn to_text(&self, m: &Metrics) -> String {
        let mut text = String::new();
        let mut line = |name: &str, value: String| {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{name:<16}{value}");
        };
        let (x, y) = self.largest_at;
        line("RMSE", format!("{:.4} of 255 ({:.3e}), {} numbers", self.rmse, self.rmse_fraction, self.transfer));
        line("PSNR", if m.psnr.is_finite() { format!("{:.2} dB", m.psnr) } else { "infinite".into() });
        line(
            "largest error",
            if m.largest > 0.0 { format!("{:.3} of 255, first at pixel {x},{y}", self.largest) } else { "none".into() },
        );
        line("off by > 1/255", format!("{:.4} % of pixels", 100.0 * self.share_beyond_255th));
        line("off by > 1/510", format!("{:.4} % of pixels", 100.0 * self.share_beyond_510th));
        line("SSIM", format!("{:.6}", self.ssim));
        line("FLIP", format!("{:.6}", self.flip));
        line(
            "verdict",
            match (m.rmse == 0.0, self.within) {
                (true, _) => "the same".into(),
                (_, true) => format!("within the tolerance of {}", self.tolerance),
                (_, false) => format!("beyond the tolerance of {}", self.tolerance),
            },
        );
        text
    }
}
