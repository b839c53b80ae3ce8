//! The command line as it is written; [`super::options`] makes sense of it.

mod farm;
mod fleet;
mod help;
mod measure;
mod scenes;

use std::path::PathBuf;
use std::time::Duration;

use clap::builder::styling::{AnsiColor, Styles};
use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use tessera_core::film::Region;
use tessera_core::settings::{Quality, Settings, Transfer};
use worker::otlp::Collector;
use worker::{Address, duration};

use super::access::{AccessFlags, PictureFlags, TokenCommand};

pub(crate) use farm::{ChangeJob, FarmFlags, Fetch, Jobs, OtlpFlags, Serve, Submit, Workers};
pub(crate) use fleet::{Fleet, FleetFlags, OwnFleet};
pub(crate) use measure::Measure;
pub(crate) use scenes::{Check, Compare};

use help::{FLEET_EXAMPLES, RENDER_EXAMPLES, RENDER_MORE};

const STYLES: Styles = Styles::styled()
    .header(AnsiColor::Green.on_default().bold())
    .usage(AnsiColor::Green.on_default().bold())
    .literal(AnsiColor::Cyan.on_default().bold())
    .placeholder(AnsiColor::Cyan.on_default());

/// Renders pm2gl scenes on any number of workers.
#[derive(Debug, Parser)]
#[command(
    name = "coordinator", version, long_version = tessera_proto::limits::BUILD, styles = STYLES, max_term_width = 100,
    after_help = "Examples:\n  \
        coordinator render scene.xml                  scene.png, on this machine\n  \
        coordinator check scene.xml                   what is wrong with it, what is in it\n  \
        coordinator compare a.png b.png --diff d.png  how far two pictures are apart\n  \
        coordinator measure scene.xml                 what accuracy costs on this scene\n\n\
        'coordinator COMMAND --help' says more about each.",
)]
pub(crate) struct Args {
    /// Log what happens to stderr (-v: steps, -vv: details, -vvv: everything); RUST_LOG overrides it
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render a scene to a picture
    #[command(after_help = RENDER_EXAMPLES, after_long_help = RENDER_MORE)]
    Render(Box<Render>),
    /// Keep a farm that stays: jobs come and go, workers and what is done stay
    #[command(after_help = "Examples:\n  \
        coordinator serve --state ~/farm                        for this machine alone\n  \
        coordinator serve --state ~/farm --listen 0.0.0.0:4747  for a network; it prints what to type elsewhere\n  \
        coordinator serve --state ~/farm --workers 2            this machine renders, too\n\n\
        Ctrl-C stops it, and so may anything else: started again, it goes on where it was.")]
    Serve(Box<Serve>),
    /// Have an engine start workers for a farm that runs already
    #[command(after_help = FLEET_EXAMPLES)]
    Fleet(Box<Fleet>),
    /// Hand scenes to a farm that stays; prints the jobs' numbers
    #[command(after_help = "Examples:\n  \
        coordinator submit scene.xml --farm big-machine --size 1920x1080\n  \
        coordinator submit frame-*.xml --farm big-machine --quality draft --wait\n  \
        coordinator fetch $(coordinator submit scene.xml --farm big-machine --wait) -o scene.png --farm big-machine")]
    Submit(Box<Submit>),
    /// Say what a farm's jobs are at
    Jobs(Jobs),
    /// Say what a farm's workers are at
    Workers(Workers),
    /// Render a job no more until it is resumed; what is done is kept
    Pause(ChangeJob),
    /// Go on with a job that is paused, or that failed
    Resume(ChangeJob),
    /// Give a job up
    Cancel(ChangeJob),
    /// Write the picture of a farm's job
    Fetch(Fetch),
    /// Validate a scene and say what is in it
    #[command(after_help = "Examples:\n  \
        coordinator check scene.xml\n  \
        coordinator check scene.xml --json | jq .scene.objects\n\n\
        Exit code: 0 the scene is valid, warnings or not; 3 it is not.")]
    Check(Check),
    /// Write the picture that a journal holds, as far as it is
    #[command(after_help = "Examples:\n  \
        coordinator picture scene.png.journal -o so-far.png\n  \
        coordinator picture scene.png.journal -o so-far.ppm --missing '#ff00ff'\n\n\
        The journal may be one that is being written, or that a crash left. In a PNG without --missing, what is not \
        there is transparent.")]
    Picture(Picture),
    /// Measure how far two pictures are apart
    #[command(after_help = "Examples:\n  \
        coordinator compare a.png b.png\n  \
        coordinator compare a.pfm b.pfm --tolerance 0.5       half an 8-bit step\n  \
        coordinator compare a.png b.exr --tolerance 1/510     the same, as a share of full scale\n  \
        coordinator compare a.png b.png --diff difference.png\n\n\
        Exit code: 0 within the tolerance, 1 beyond it or of another size, 2 a file cannot be read.")]
    Compare(Compare),
    /// Measure what accuracy costs on a scene, and recommend a setting
    #[command(after_help = measure::EXAMPLES, after_long_help = measure::MORE)]
    Measure(Box<Measure>),
    /// Print the token that lets workers of other machines join, or make another
    #[command(after_help = "Examples:\n  \
        coordinator token                             print it; it is made on first use\n  \
        coordinator token show > token.txt            for 'worker --token-file token.txt'\n  \
        coordinator token renew                       the one before lets nobody in any more")]
    Token {
        #[command(subcommand)]
        command: Option<TokenCommand>,
        /// The token of the users of a farm that stays, which lets no worker in
        #[arg(long, global = true)]
        user: bool,
    },
    /// Print a script that completes this program's commands and flags in a shell
    #[command(after_help = "Examples:\n  \
        coordinator completions bash > ~/.local/share/bash-completion/completions/coordinator\n  \
        coordinator completions fish > ~/.config/fish/completions/coordinator.fish")]
    Completions {
        /// The shell
        shell: Shell,
    },
}

impl Command {
    /// Where its spans are sent.
    pub(crate) fn otlp(&self) -> Option<&Collector> {
        match self {
            Self::Render(raw) => raw.otlp.otlp.as_ref(),
            Self::Serve(raw) => raw.otlp.otlp.as_ref(),
            Self::Submit(raw) => raw.otlp.otlp.as_ref(),
            _ => None,
        }
    }
}

/// What is rendered, and how well.
#[derive(Clone, Debug, ClapArgs)]
pub(crate) struct ViewFlags {
    /// Pixels across and down
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size, allow_hyphen_values = true, help_heading = "Picture")]
    pub(crate) size: (u32, u32),
    /// Write only this part of the picture: half-open, in pixels from the upper left corner
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = region, allow_hyphen_values = true, help_heading = "Picture")]
    pub(crate) region: Option<Region>,
    /// What colour numbers of the scene, its pictures and 8/16-bit files mean
    #[arg(long, value_name = "KIND", default_value = "srgb", help_heading = "Picture")]
    pub(crate) transfer: TransferArg,

    /// Distance of the image plane from the camera
    #[arg(long, value_name = "Z", default_value = "1", allow_hyphen_values = true, help_heading = "Camera")]
    pub(crate) zoom: f64,
    /// Height of the image plane; its width follows, since pixels are square
    #[arg(long, value_name = "H", default_value = "1", allow_hyphen_values = true, help_heading = "Camera")]
    pub(crate) plane_height: f64,

    /// Rays in a path at most, the camera's included: 1 shows no reflections
    #[arg(long, value_name = "D", default_value = "16", value_parser = clap::value_parser!(u32).range(1..=i64::from(Settings::MAX_DEPTH)), allow_hyphen_values = true, help_heading = "Accuracy")]
    pub(crate) max_depth: u32,
    /// Root mean squared error by name: draft is 2 8-bit steps, normal 0.5, final 0.25, reference 0.05 [default: normal, unless another accuracy is asked for]
    #[arg(long, value_name = "NAME", conflicts_with_all = ["max_error", "time_limit", "samples"], help_heading = "Accuracy")]
    pub(crate) quality: Option<QualityArg>,
    /// Root mean squared error at most: in 8-bit steps (0.5), or as a fraction of full scale (1/510)
    #[arg(long, value_name = "E", value_parser = target, allow_hyphen_values = true, conflicts_with = "samples", help_heading = "Accuracy")]
    pub(crate) max_error: Option<f64>,
    /// The best picture in this time, from start to written file: 90s, 1.5m, 2h, 500ms; with --max-error, no better than that
    #[arg(long, value_name = "D", value_parser = duration, allow_hyphen_values = true, conflicts_with = "samples", help_heading = "Accuracy")]
    pub(crate) time_limit: Option<Duration>,
    /// So many points in every pixel: a square number, 1, 4, 9, 16, … 4096
    #[arg(long, value_name = "N", allow_hyphen_values = true, help_heading = "Accuracy")]
    pub(crate) samples: Option<u64>,
    /// Where the points of --samples are: in a grid, or scattered evenly and otherwise in every pixel; those may be any number up to 4096
    #[arg(long, value_name = "KIND", default_value = "grid", requires = "samples", help_heading = "Accuracy")]
    pub(crate) pattern: PatternArg,

    /// Share of the tiles that are rendered a second time elsewhere and compared: 5%, 1/20, all; the first two of every worker too
    #[arg(long, value_name = "SHARE", default_value = "0", value_parser = super::verification::share, help_heading = "Farm")]
    pub(crate) verify: f64,
    /// Edge of a tile in pixels, 1 to 256, or 'auto': by what pixels cost
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = tile, allow_hyphen_values = true, help_heading = "Farm")]
    pub(crate) tile: TileArg,
}

/// Flags of `render`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Render {
    /// Scene to render
    pub(crate) scene: PathBuf,
    #[command(flatten)]
    pub(crate) pictures: PictureFlags,

    /// Picture to write: .png, .ppm (P6), .pfm or .exr [default: the scene's name with .png, in the current folder]
    #[arg(short, long, value_name = "FILE", help_heading = "Picture")]
    pub(crate) output: Option<PathBuf>,
    /// Bits of each colour in PNG and PPM files
    #[arg(long, value_name = "8|16", default_value = "8", value_parser = ["8", "16"], help_heading = "Picture")]
    pub(crate) bits: String,
    #[command(flatten)]
    pub(crate) view: ViewFlags,

    /// Workers started inside this process [default: 2; with --listen, 0]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=256), allow_hyphen_values = true, help_heading = "Farm")]
    pub(crate) workers: Option<u16>,
    /// Threads of all workers in this process together [default: one a core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024), allow_hyphen_values = true, help_heading = "Farm")]
    pub(crate) threads: Option<u16>,
    /// Also take workers that connect from elsewhere: HOST[:PORT] or PORT, port 4747 where none is given
    #[arg(long, value_name = "ADDR", help_heading = "Farm")]
    pub(crate) listen: Option<String>,
    /// Show the picture as it grows on a page there: HOST:PORT, or PORT for this machine alone; beyond it, with TLS and the users' token
    #[arg(long, value_name = "ADDR", default_value = "none", help_heading = "Farm")]
    pub(crate) http: String,
    /// How long to go on without any worker: 90s, 1h, 'forever' [default: 30s for the first, 5m after one was lost]
    #[arg(long, value_name = "D|forever", value_parser = patience, allow_hyphen_values = true, help_heading = "Farm")]
    pub(crate) wait_for_workers: Option<Duration>,
    #[command(flatten)]
    pub(crate) fleet: OwnFleet,
    #[command(flatten)]
    pub(crate) access: AccessFlags,
    /// Have a farm that stays render it: HOST[:PORT], as 'coordinator serve' listens
    #[arg(long, value_name = "HOST[:PORT]", conflicts_with_all = ["listen", "http", "fleet", "workers", "wait_for_workers", "tls_cert", "insecure", "restart", "journal"], help_heading = "Farm")]
    pub(crate) farm: Option<Address>,

    /// Keep what is done in FILE, from where the same command goes on after whatever ended it; 'none' keeps nothing [default: OUTPUT.journal, as soon as a render takes 2 s; it goes when the picture is written]
    #[arg(long, value_name = "FILE|none", help_heading = "Going on")]
    pub(crate) journal: Option<PathBuf>,
    /// Begin anew, whatever an earlier run left
    #[arg(long, help_heading = "Going on")]
    pub(crate) restart: bool,

    /// Write what was rendered, how long it took, how many rays, and a hash of the pixels as JSON; '-' is stdout
    #[arg(long, value_name = "FILE", help_heading = "Reporting")]
    pub(crate) report: Option<PathBuf>,
    /// How to show progress on stderr; 'auto' is a bar on a terminal, a line every 10 s elsewhere
    #[arg(long, value_name = "KIND", default_value = "auto", help_heading = "Reporting")]
    pub(crate) progress: ProgressArg,
    #[command(flatten)]
    pub(crate) otlp: OtlpFlags,
}

/// Flags of `picture`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Picture {
    /// The journal of a render
    pub(crate) journal: PathBuf,
    /// Picture to write: .png, .ppm (P6), .pfm or .exr, as far as the journal holds what it needs
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Bits of each colour in PNG and PPM files [default: as the journal has them, or 8]
    #[arg(long, value_name = "8|16", value_parser = ["8", "16"])]
    pub(crate) bits: Option<String>,
    /// Colour of what is not there: #rrggbb [default: transparent in PNG files, else black]
    #[arg(long, value_name = "COLOUR", value_parser = colour)]
    pub(crate) missing: Option<[u8; 3]>,
}

/// Meaning of colour numbers.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum TransferArg {
    /// Encoded as in ordinary picture files and colour pickers
    Srgb,
    /// Proportional to light
    Linear,
}

impl From<TransferArg> for Transfer {
    fn from(arg: TransferArg) -> Self {
        match arg {
            TransferArg::Srgb => Self::Srgb,
            TransferArg::Linear => Self::Linear,
        }
    }
}

/// Points on the curve of time against accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum QualityArg {
    /// To see what is where
    Draft,
    /// To use it
    #[value(alias = "preview")]
    Normal,
    /// To print it
    Final,
    /// To hold others against it
    Reference,
}

impl From<QualityArg> for Quality {
    fn from(arg: QualityArg) -> Self {
        match arg {
            QualityArg::Draft => Self::Draft,
            QualityArg::Normal => Self::Normal,
            QualityArg::Final => Self::Final,
            QualityArg::Reference => Self::Reference,
        }
    }
}

/// Where points of a pixel are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PatternArg {
    /// The centres of a grid
    Grid,
    /// Scrambled low-discrepancy points, others in every pixel
    Scrambled,
}

/// Ways to show progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressArg {
    /// A bar on a terminal, else plain
    Auto,
    /// A bar
    Bar,
    /// A line every 10 s
    Plain,
    /// A JSON object a line, every second
    Json,
    /// Nothing
    None,
}

/// Edge of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TileArg {
    Auto,
    Edge(u32),
}

pub(super) fn size(text: &str) -> Result<(u32, u32), String> {
    let wrong = || "expected WIDTHxHEIGHT in pixels, such as 640x480".to_string();
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    let edge = |t: &str| match t.trim().parse::<u64>() {
        Ok(n) if (1..=65536).contains(&n) => Ok(n as u32),
        Ok(_) => Err("a picture is 1 to 65536 pixels wide and high".to_string()),
        Err(e) if *e.kind() == std::num::IntErrorKind::PosOverflow => {
            Err("a picture is 1 to 65536 pixels wide and high".to_string())
        }
        Err(_) => Err(wrong()),
    };
    Ok((edge(w)?, edge(h)?))
}

fn region(text: &str) -> Result<Region, String> {
    let numbers: Vec<u32> = text
        .split(',')
        .map(|t| t.trim().parse().map_err(|_| format!("'{t}' is not a pixel's number; expected X0,Y0,X1,Y1")))
        .collect::<Result<_, _>>()?;
    let &[x0, y0, x1, y1] = &numbers[..] else {
        return Err(format!("expected four numbers X0,Y0,X1,Y1, not {}", numbers.len()));
    };
    Region::new(x0, y0, x1, y1)
        .ok_or_else(|| "it is empty: X1 must be above X0 and Y1 above Y0 (both ends are pixels' edges)".into())
}

fn colour(text: &str) -> Result<[u8; 3], String> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let number = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6 && !digits.starts_with('+'));
    let [_, r, g, b] = number.ok_or("expected a colour as #rrggbb, such as #ff00ff")?.to_be_bytes();
    Ok([r, g, b])
}

fn tile(text: &str) -> Result<TileArg, String> {
    if text == "auto" {
        return Ok(TileArg::Auto);
    }
    match text.parse() {
        Ok(n @ 1..=256) => Ok(TileArg::Edge(n)),
        _ => Err("expected 'auto' or an edge of 1 to 256 pixels".into()),
    }
}

/// How long to wait, where that may be for ever.
fn patience(text: &str) -> Result<Duration, String> {
    match text.trim() {
        "forever" => Ok(Duration::MAX),
        text => duration(text).map_err(|e| format!("{e}; or 'forever'")),
    }
}

/// An error to aim at, in 8-bit steps.
pub(super) fn target(text: &str) -> Result<f64, String> {
    match tolerance(text)? {
        e if e > 0.0 => Ok(e),
        _ => Err("an error to aim at must be above 0; '--quality reference' goes as far as is sensible".into()),
    }
}

/// An error in 8-bit steps, written as that or as a fraction of full scale.
fn tolerance(text: &str) -> Result<f64, String> {
    let wrong = || "expected 8-bit steps, such as 0.5, or a fraction of full scale, such as 1/510".to_string();
    let number = |t: &str| t.trim().parse::<f64>().ok().filter(|x| x.is_finite() && *x >= 0.0).ok_or_else(wrong);
    match text.split_once('/') {
        None => number(text),
        Some((above, below)) => {
            let share = number(above)? / number(below)?;
            if share.is_finite() { Ok(share * 255.0) } else { Err(wrong()) }
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_holds_together() {
        Args::command().debug_assert();
    }

    #[test]
    fn tolerances_are_steps_or_fractions() {
        assert_eq!(tolerance("0.5"), Ok(0.5));
        assert_eq!(tolerance("1/510"), Ok(0.5));
        assert_eq!(target("1/510"), Ok(0.5));
        assert!(target("0").is_err_and(|e| e.contains("above 0")) && target("-1").is_err());
        for bad in ["", "-1", "1/0", "0/0", "x", "1/2/3", "inf", "NaN"] {
            assert!(tolerance(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn colours_are_written_as_on_the_web() {
        assert_eq!(colour("#ff0080"), Ok([255, 0, 128]));
        assert_eq!(colour("00ff00"), Ok([0, 255, 0]));
        for bad in ["", "#fff", "red", "#gg0000", "+12345", "#1234567"] {
            assert!(colour(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn patience_may_be_without_end() {
        assert_eq!(patience("forever"), Ok(Duration::MAX));
        assert_eq!(patience("5m"), Ok(Duration::from_secs(300)));
        assert!(patience("never").is_err_and(|e| e.contains("forever")));
    }

    #[test]
    fn sizes_and_regions_say_what_they_want() {
        assert_eq!(size("12X7"), Ok((12, 7)));
        for bad in ["0x5", "5x0", "65537x1", "99999999999999999999999x1"] {
            assert!(size(bad).is_err_and(|e| e.contains("1 to 65536")), "{bad}");
        }
        for bad in ["", "640", "-1x5", "axb", "1x2x3", "1.5x2"] {
            assert!(size(bad).is_err_and(|e| e.contains("WIDTHxHEIGHT")), "{bad}");
        }
        assert!(region("0,0,4,4").is_ok());
        for (bad, why) in [("0,0,0,4", "empty"), ("1,2,3", "four"), ("-1,0,2,2", "'-1'"), ("1,1,1e3,2", "'1e3'")] {
            assert!(region(bad).is_err_and(|e| e.contains(why)), "{bad}");
        }
    }
}
