//! The command line of `measure` as it is written.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use tessera_core::settings::Settings;

use super::{ProgressArg, TransferArg, duration, size, target};
use crate::cli::access::PictureFlags;

pub(super) const EXAMPLES: &str = "Examples:\n  \
    coordinator measure scene.xml                     what 0.5 costs, in at most 10 minutes\n  \
    coordinator measure scene.xml --target 1/510 --size 1920x1080 --budget 1h\n  \
    coordinator measure scene.xml --reference exact.pfm\n  \
    coordinator measure scene.xml --peers             POV-Ray's anti-aliasing beside ours\n\n\
    '--help' says more about every flag.";

pub(super) const MORE: &str = "Examples:\n  \
    coordinator measure scene.xml\n      \
        what an RMSE of 0.5 8-bit steps costs: a table, and scene-curve.csv, .json, .svg and .png\n  \
    coordinator measure scene.xml --target 1/510 --size 1920x1080 --budget 1h\n      \
        the same error as a fraction of full scale, for a larger picture, in an hour\n  \
    coordinator measure scene.xml --reference exact.pfm --repeat 9\n      \
        against a picture of your own; every time is the median of nine\n  \
    coordinator measure scene.xml --peers -o curves/scene\n      \
        POV-Ray's anti-aliasing beside ours; curves/scene.csv, .json, .svg and .png\n\n\
    Every picture is rendered as 'render' would. The reference is rendered by uniform grids of\n\
    prime sizes, whose errors have next to nothing in common with each other's or with those of\n\
    the settings that are judged; how far they are apart tells the reference's own error.\n\n\
    Exit codes:\n  \
    0    done, whether or not a setting reaches the target\n  \
    1    a render failed, or the budget sufficed for nothing\n  \
    2    the arguments make no sense, the reference is no picture of that size, or no files can be written\n  \
    3    the scene is not valid\n  \
    130  interrupted; what was measured is written\n\n\
    A first Ctrl-C stops and writes what there is, a second one leaves at once.";

/// Flags of `measure`.
#[derive(Debug, Args)]
pub(crate) struct Measure {
    /// Scene to measure
    pub(crate) scene: PathBuf,

    /// Files to write: PREFIX.csv, .json, .svg and .png [default: the scene's name with -curve, in the current folder]
    #[arg(short, long, value_name = "PREFIX", help_heading = "Results")]
    pub(crate) output: Option<PathBuf>,
    /// Error to recommend a setting for: RMSE in 8-bit steps (0.5), or as a fraction of full scale (1/510)
    #[arg(long, value_name = "E", default_value = "0.5", value_parser = target, allow_hyphen_values = true, help_heading = "Results")]
    pub(crate) target: f64,
    /// How to show progress on stderr; 'auto' is a bar on a terminal, a line every 10 s elsewhere
    #[arg(long, value_name = "KIND", default_value = "auto", help_heading = "Results")]
    pub(crate) progress: ProgressArg,

    /// Time for all of it: 90s, 5m, 1h; what does not fit is left out, and 'none' leaves out nothing
    #[arg(long, value_name = "D", default_value = "10m", value_parser = budget, allow_hyphen_values = true, help_heading = "Measurement")]
    pub(crate) budget: Budget,
    /// Render every setting K times and take the median time [default: 5 times below 0.3 s, 3 below 1.5 s, else once]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=1000), allow_hyphen_values = true, help_heading = "Measurement")]
    pub(crate) repeat: Option<u32>,
    /// Picture to measure against, of the same size: .pfm, .exr, .png or .ppm [default: one is rendered]
    #[arg(long, value_name = "FILE", conflicts_with = "reference_samples", help_heading = "Measurement")]
    pub(crate) reference: Option<PathBuf>,
    /// Samples a pixel of the rendered reference, at least [default: from 290 on, until it is five times as good as the target]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=7202), allow_hyphen_values = true, help_heading = "Measurement")]
    pub(crate) reference_samples: Option<u32>,
    /// Also measure POV-Ray, where it is installed, at several settings of its anti-aliasing
    #[arg(long, help_heading = "Measurement")]
    pub(crate) peers: bool,

    #[command(flatten)]
    pub(crate) pictures: PictureFlags,
    /// Pixels across and down
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size, allow_hyphen_values = true, help_heading = "Picture")]
    pub(crate) size: (u32, u32),
    /// What colour numbers of the scene and its pictures mean
    #[arg(long, value_name = "KIND", default_value = "srgb", help_heading = "Picture")]
    pub(crate) transfer: TransferArg,
    /// Distance of the image plane from the camera
    #[arg(long, value_name = "Z", default_value = "1", allow_hyphen_values = true, help_heading = "Picture")]
    pub(crate) zoom: f64,
    /// Height of the image plane; its width follows, since pixels are square
    #[arg(long, value_name = "H", default_value = "1", allow_hyphen_values = true, help_heading = "Picture")]
    pub(crate) plane_height: f64,
    /// Rays in a path at most, the camera's included; shorter paths are measured too where there are mirrors
    #[arg(long, value_name = "D", default_value = "16", value_parser = clap::value_parser!(u32).range(1..=i64::from(Settings::MAX_DEPTH)), allow_hyphen_values = true, help_heading = "Picture")]
    pub(crate) max_depth: u32,

    /// Workers started inside this process [default: 2]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256), allow_hyphen_values = true, help_heading = "Farm")]
    pub(crate) workers: Option<u16>,
    /// Threads of all workers together [default: one a core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024), allow_hyphen_values = true, help_heading = "Farm")]
    pub(crate) threads: Option<u16>,
}

/// How long all of it may take; `None` is as long as it takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Budget(pub(crate) Option<Duration>);

fn budget(text: &str) -> Result<Budget, String> {
    if text == "none" {
        return Ok(Budget(None));
    }
    duration(text).map(|d| Budget(Some(d))).map_err(|e| format!("{e}, or 'none'"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_are_times_or_none() {
        assert_eq!(budget("none"), Ok(Budget(None)));
        assert_eq!(budget("5m"), Ok(Budget(Some(Duration::from_secs(300)))));
        assert!(budget("-1s").is_err_and(|e| e.ends_with("or 'none'")));
    }
}
