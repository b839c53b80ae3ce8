//! Flags of the commands that look at a scene or at pictures.

use std::path::PathBuf;

use clap::Args as ClapArgs;

use super::{TransferArg, tolerance};
use crate::cli::access::PictureFlags;

/// Flags of `check`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Check {
    /// Scene to check
    pub(crate) scene: PathBuf,
    #[command(flatten)]
    pub(crate) pictures: PictureFlags,
    /// Print JSON for machines instead of text
    #[arg(long)]
    pub(crate) json: bool,
}

/// Flags of `compare`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Compare {
    /// The picture taken as right: .png, .ppm, .pfm or .exr
    pub(crate) a: PathBuf,
    /// The picture compared with it, of the same size
    pub(crate) b: PathBuf,
    /// Write a picture of the differences in false colour, with a scale
    #[arg(long, value_name = "FILE")]
    pub(crate) diff: Option<PathBuf>,
    /// Largest RMSE to accept: in 8-bit steps (0.5), or as a fraction of full scale (1/510)
    #[arg(long, value_name = "T", default_value = "0", value_parser = tolerance, allow_hyphen_values = true)]
    pub(crate) tolerance: f64,
    /// Compare encoded or linear numbers [default: as the files' codes are meant; linear where both hold floats]
    #[arg(long, value_name = "KIND")]
    pub(crate) transfer: Option<TransferArg>,
    /// Print JSON for machines instead of text
    #[arg(long)]
    pub(crate) json: bool,
}
