//! Flags of the commands around a farm that stays.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args as ClapArgs;
use coordinator::Keep;
use worker::Address;
use worker::otlp::Collector;

use super::{OwnFleet, ViewFlags, colour};
use crate::cli::access::{AccessFlags, PictureFlags};

/// Where a farm that stays is, and how to be let in.
#[derive(Clone, Debug, Default, ClapArgs)]
pub(crate) struct FarmFlags {
    /// The farm: HOST[:PORT], or PORT for one on this machine [default: what TESSERA_FARM holds]
    #[arg(long, value_name = "HOST[:PORT]", help_heading = "Farm")]
    pub(crate) farm: Option<Address>,
    /// File that holds the users' token [default: what TESSERA_TOKEN holds, or this user's own]
    #[arg(long, value_name = "FILE", help_heading = "Farm", id = "user_token_file")]
    pub(crate) user_token: Option<PathBuf>,
}

/// What is told of what happens, beside the log.
#[derive(Clone, Debug, Default, ClapArgs)]
pub(crate) struct OtlpFlags {
    /// Send spans, from submit to stitched tile, to an OpenTelemetry collector, as OTLP over gRPC: http://HOST[:PORT], port 4317 where none is given
    #[arg(long, value_name = "URL", help_heading = "Reporting")]
    pub(crate) otlp: Option<Collector>,
}

/// Flags of `serve`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Serve {
    /// Folder where jobs, scenes and pictures are kept; it is made where it is missing
    #[arg(long, value_name = "DIR")]
    pub(crate) state: PathBuf,
    /// Where workers and users are awaited: HOST[:PORT] or PORT
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:4747")]
    pub(crate) listen: String,
    /// Where the page and the interface for machines are: HOST:PORT, PORT for this machine alone, or 'none'; beyond this machine, with TLS and the users' token
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8080")]
    pub(crate) http: String,
    /// Keep finished jobs for so long (30d), or pictures of so many bytes together (20G); none goes in its first day that nobody fetched [default: all of them]
    #[arg(long, value_name = "SIZE|D")]
    pub(crate) keep: Option<Keep>,
    /// Workers started inside this process
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=256))]
    pub(crate) workers: u16,
    /// Threads of all workers in this process together [default: one a core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Where the users' token is kept; made on first use [default: in the user's state folder]
    #[arg(long, value_name = "FILE", help_heading = "Farm")]
    pub(crate) user_token_file: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) fleet: OwnFleet,
    #[command(flatten)]
    pub(crate) access: AccessFlags,
    #[command(flatten)]
    pub(crate) otlp: OtlpFlags,
}

/// Flags of `submit`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Submit {
    /// Scenes to render, each a job
    #[arg(required = true)]
    pub(crate) scenes: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) pictures: PictureFlags,
    #[command(flatten)]
    pub(crate) view: ViewFlags,
    /// What is kept of each colour: what is fetched as .png or .ppm of so many bits, or floats, which make any picture
    #[arg(long, value_name = "8|16|float", default_value = "float", value_parser = ["8", "16", "float"], help_heading = "Picture")]
    pub(crate) bits: String,
    /// Name of the job [default: the scene's]
    #[arg(long, value_name = "TEXT", help_heading = "Job")]
    pub(crate) name: Option<String>,
    /// Whose job it is: workers are split between owners evenly [default: this user]
    #[arg(long, value_name = "NAME", help_heading = "Job")]
    pub(crate) owner: Option<String>,
    /// Of an owner's jobs, those of a higher priority come first: -1000 to 1000
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(i32).range(-1000..=1000), allow_hyphen_values = true, help_heading = "Job")]
    pub(crate) priority: i32,
    /// Give it up when it is not done after so long (90s, 2h); what is done is kept, and 'resume' goes on without one
    #[arg(long, value_name = "D", value_parser = super::duration, help_heading = "Job")]
    pub(crate) deadline: Option<Duration>,
    /// Wait until all are done
    #[arg(long, help_heading = "Job")]
    pub(crate) wait: bool,
    #[command(flatten)]
    pub(crate) farm: FarmFlags,
    #[command(flatten)]
    pub(crate) otlp: OtlpFlags,
}

/// Flags of `jobs`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Jobs {
    /// Only this one
    pub(crate) id: Option<u64>,
    /// Print the numbers alone, for a shell's completion
    #[arg(long, hide = true)]
    pub(crate) ids: bool,
    /// Say it again whenever it changed, until all are done
    #[arg(long)]
    pub(crate) watch: bool,
    /// Print JSON for machines instead of text
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) farm: FarmFlags,
}

/// Flags of `workers`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Workers {
    /// Print JSON for machines instead of text
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) farm: FarmFlags,
}

/// Flags of `pause`, `resume` and `cancel`.
#[derive(Debug, ClapArgs)]
pub(crate) struct ChangeJob {
    /// The jobs' numbers
    #[arg(required = true, value_name = "ID")]
    pub(crate) ids: Vec<u64>,
    #[command(flatten)]
    pub(crate) farm: FarmFlags,
}

/// Flags of `fetch`.
#[derive(Debug, ClapArgs)]
pub(crate) struct Fetch {
    /// The job's number
    pub(crate) id: u64,
    /// Picture to write: .png, .ppm (P6), .pfm or .exr, as far as what is kept holds what it needs
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Bits of each colour in PNG and PPM files [default: as they are kept, or 8]
    #[arg(long, value_name = "8|16", value_parser = ["8", "16"])]
    pub(crate) bits: Option<String>,
    /// Also a picture that is not whole, as far as it is
    #[arg(long)]
    pub(crate) partial: bool,
    /// Colour of what is not there: #rrggbb [default: transparent in PNG files, else black]
    #[arg(long, value_name = "COLOUR", value_parser = colour, requires = "partial")]
    pub(crate) missing: Option<[u8; 3]>,
    #[command(flatten)]
    pub(crate) farm: FarmFlags,
}
