//! What a journal holds, read again.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::trace::RayCounts;
use tessera_proto::PixelFormat;
use tessera_proto::convert::{Lease, Malformed, TileDone, check_pixels, check_size, printable};
use tessera_proto::identity::WorkerId;
use tessera_proto::journal::record::Kind;
use tessera_proto::journal::{self, Record};

use super::frame::{self, Extent, LETTERS, Location, MAGIC};
use super::head::Head;
use crate::progress::CheckedTile;

/// Why a journal cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The system refused.
    #[error("the journal '{}' cannot be used: {}", .0.display(), .1)]
    Io(PathBuf, io::Error),
    /// Something else bears the name.
    #[error("'{}' is no journal: move it away, or choose another place by --journal", .0.display())]
    Foreign(PathBuf),
    /// Another version of this program wrote it.
    #[error(
        "the journal '{}' is of another version of this program: go on with that one, or begin anew by --restart",
        .0.display()
    )]
    Version(PathBuf),
    /// A render at work writes it.
    #[error("another render is at work on '{}': wait for it, or choose another output", .0.display())]
    Busy(PathBuf),
    /// What was on the disk is not there any more as it was.
    #[error(
        "the journal '{}' is damaged at byte {at}: what stands before can be seen by 'coordinator picture', \
         and --restart begins anew",
        .path.display()
    )]
    Damaged {
        /// The journal.
        path: PathBuf,
        /// Where it is damaged, in bytes from its beginning.
        at: u64,
    },
    /// Its records are not those of a picture.
    #[error("the journal '{}' is not sound: {}; --restart begins anew", .0.display(), .1)]
    Unsound(PathBuf, String),
    /// It is of another picture.
    #[error(
        "the journal '{}' is of another render; other are: {}. Give the same command to go on, --restart to begin \
         anew, or another place by --journal",
        .path.display(), .differences.join(", ")
    )]
    Other {
        /// The journal.
        path: PathBuf,
        /// What is not the same.
        differences: Vec<String>,
    },
}

/// A tile that need not be rendered again.
#[derive(Clone, Debug)]
pub(crate) struct Kept {
    /// How it was rendered.
    pub(crate) lease: Lease,
    pub(crate) error: ErrorEstimate,
    pub(crate) rays: RayCounts,
    /// Where its pixels are.
    pub(crate) place: Location,
    /// By whom, where tiles are verified.
    pub(crate) made: Option<Made>,
}

/// What verification knows of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Made {
    pub(crate) maker: WorkerId,
    /// Of what it delivered.
    pub(crate) sum: [u8; 32],
    /// Whether the tile was found to be what the scene shows.
    pub(crate) confirmed: bool,
}

/// What verification came to in earlier runs.
#[derive(Debug, Default)]
pub(crate) struct Verified {
    pub(crate) checks: Vec<CheckedTile>,
    /// What workers are called.
    pub(crate) names: BTreeMap<WorkerId, String>,
    pub(crate) thrown_out: Vec<ThrownOut>,
}

/// A worker that lied.
#[derive(Clone, Debug)]
pub(crate) struct ThrownOut {
    pub(crate) worker: WorkerId,
    pub(crate) name: String,
    /// What it did.
    pub(crate) rule: String,
    /// Tiles that were to be rendered again.
    pub(crate) redone: u64,
}

/// What is known of a pass.
#[derive(Debug, Default)]
pub(crate) struct KeptPass {
    pub(crate) tiles: Vec<Kept>,
    /// How long it took and when it ended, where it did.
    pub(crate) ended: Option<(Duration, Duration)>,
}

/// What a journal holds.
#[derive(Debug)]
pub struct Recovered {
    pub(super) head: Head,
    /// To be written behind its end.
    pub(super) file: File,
    /// To be read from, wherever the other one is written.
    pub(super) reader: File,
    /// Where sound records end.
    pub(super) end: u64,
    pub(super) damaged: bool,
    pub(super) passes: BTreeMap<u32, KeptPass>,
    pub(super) verified: Verified,
    /// Time that was rendered for, over all runs.
    pub(super) spent: Duration,
}

/// A journal's file, if there is one, for this process alone.
pub(super) fn open(path: &Path) -> Result<Option<File>, JournalError> {
    let failed = |e| JournalError::Io(path.into(), e);
    let file = match OpenOptions::new().read(true).write(true).open(path) {
        Ok(file) => file,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(failed(e)),
    };
    if !file.metadata().map_err(failed)?.is_file() {
        return Err(JournalError::Foreign(path.into()));
    }
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(JournalError::Busy(path.into())),
        // Where files cannot be locked there is no telling.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(Some(file)),
    }
}

/// Reads the journal `file`, called `path`; `None` where it ends before anything was done.
pub(super) fn read(file: File, path: &Path) -> Result<Option<Recovered>, JournalError> {
    let mut reading = Reading::default();
    let extent = frame::scan(&file, |place, record| reading.take(place, record)).map_err(|e: Failed| e.named(path))?;
    let (end, damaged) = match extent {
        Extent::Until(end) => (end, false),
        Extent::Damaged(at) => (at, true),
        Extent::Foreign => return Err(foreign(&file, path)),
    };
    let Reading { head, passes, verified, spent, .. } = reading;
    match head {
        Some(head) => {
            let reader = File::open(path).map_err(|e| JournalError::Io(path.into(), e))?;
            Ok(Some(Recovered { head, file, reader, end, damaged, passes, verified, spent }))
        }
        None if damaged => Err(JournalError::Damaged { path: path.into(), at: end }),
        None => Ok(None),
    }
}

/// What a file is that does not begin as a journal of this version.
fn foreign(mut file: &File, path: &Path) -> JournalError {
    use std::io::{Read, Seek, SeekFrom};
    let mut letters = [0; LETTERS];
    let read = file.seek(SeekFrom::Start(0)).and_then(|_| file.read_exact(&mut letters));
    if read.is_ok() && letters == MAGIC[..LETTERS] {
        JournalError::Version(path.into())
    } else {
        JournalError::Foreign(path.into())
    }
}

/// Why reading stops.
enum Failed {
    Io(io::Error),
    Unsound(String),
}

impl From<io::Error> for Failed {
    fn from(e: io::Error) -> Self {
        Self::Io(e)
    }
}

impl From<Malformed> for Failed {
    fn from(e: Malformed) -> Self {
        Self::Unsound(e.to_string())
    }
}

impl Failed {
    fn named(self, path: &Path) -> JournalError {
        match self {
            Self::Io(e) => JournalError::Io(path.into(), e),
            Self::Unsound(why) => JournalError::Unsound(path.into(), why),
        }
    }
}

#[derive(Default)]
struct Reading {
    head: Option<Head>,
    passes: BTreeMap<u32, KeptPass>,
    verified: Verified,
    /// Where tiles are in `passes`, by pass and region, where they are verified.
    places: BTreeMap<(u32, Region), usize>,
    spent: Duration,
}

impl Reading {
    fn take(&mut self, place: Location, record: Record) -> Result<(), Failed> {
        let kind = record.kind.ok_or(Malformed::Missing("a record"))?;
        match (&self.head, kind) {
            (None, Kind::Head(head)) => self.head = Some(head.try_into()?),
            (None, _) => return Err(Malformed::Missing("the head").into()),
            (Some(_), Kind::Head(_)) => return Err(Failed::Unsound("it has two heads".into())),
            (Some(head), Kind::Tile(tile)) => {
                let (region, pixels, verified) = (head.region, head.pixels, head.verified);
                self.tile(place, tile, (region, pixels), verified)?;
            }
            (Some(_), Kind::Checked(checked)) => self.checked(checked)?,
            (Some(_), Kind::ThrownOut(out)) => self.thrown_out(out)?,
            (Some(_), Kind::Passed(passed)) => {
                let nanos = Duration::from_nanos;
                let ended = Some((nanos(passed.took_ns), nanos(passed.now_ns)));
                self.passes.entry(passed.pass).or_default().ended = ended;
                self.spent = self.spent.max(nanos(passed.now_ns));
            }
        }
        Ok(())
    }

    fn tile(
        &mut self,
        place: Location,
        tile: journal::Tile,
        (whole, format): (Region, PixelFormat),
        verified: bool,
    ) -> Result<(), Failed> {
        let lease = Lease::try_from(tile.lease.ok_or(Malformed::Missing("a lease"))?)?;
        let done = TileDone::try_from(tile.done.ok_or(Malformed::Missing("a tile"))?)?;
        if !whole.contains(&lease.region) {
            return Err(Malformed::Range("a region").into());
        }
        if !done.pixels.is_empty() {
            check_pixels(&done.pixels, format)?;
            check_size(&done.pixels, format, &lease.region)?;
        }
        let made = if verified {
            let sum = tile.sum_sha256[..].try_into().map_err(|_| Malformed::Range("a tile's sum"))?;
            let maker = key(&tile.key)?;
            self.verified.names.entry(maker).or_insert_with(|| printable(&tile.worker));
            Some(Made { maker, sum, confirmed: false })
        } else {
            None
        };
        let kept = Kept { lease, error: done.error, rays: done.rays, place, made };
        let tiles = &mut self.passes.entry(lease.number.0).or_default().tiles;
        if verified {
            self.places.insert((lease.number.0, lease.region), tiles.len());
        }
        tiles.push(kept);
        self.spent = self.spent.max(Duration::from_micros(tile.at_us));
        Ok(())
    }
}

impl Reading {
    fn checked(&mut self, checked: journal::Checked) -> Result<(), Failed> {
        let region = Region::try_from(checked.region.ok_or(Malformed::Missing("a region"))?)?;
        // The disk may have refused the tile itself.
        if checked.confirmed
            && let Some(&place) = self.places.get(&(checked.pass, region))
            && let Some(pass) = self.passes.get_mut(&checked.pass)
            && let Some(made) = pass.tiles.get_mut(place).and_then(|kept| kept.made.as_mut())
        {
            made.confirmed = true;
        }
        let checker = (!checked.checked_by.is_empty()).then(|| printable(&checked.checked_by));
        let (maker, agreed) = (printable(&checked.made_by), checked.agreed);
        self.verified.checks.push(CheckedTile { region, maker, checker, agreed });
        Ok(())
    }

    fn thrown_out(&mut self, out: journal::ThrownOut) -> Result<(), Failed> {
        let worker = key(&out.key)?;
        let stands = |kept: &Kept| kept.made.is_none_or(|made| made.maker != worker || made.confirmed);
        self.passes.values_mut().for_each(|pass| pass.tiles.retain(stands));
        self.places.clear();
        for (&number, pass) in &self.passes {
            self.places.extend(pass.tiles.iter().enumerate().map(|(k, tile)| ((number, tile.lease.region), k)));
        }
        let (name, rule, redone) = (printable(&out.name), printable(&out.rule), out.redone);
        self.verified.thrown_out.push(ThrownOut { worker, name, rule, redone });
        Ok(())
    }
}

fn key(bytes: &[u8]) -> Result<WorkerId, Malformed> {
    bytes.try_into().map(WorkerId).map_err(|_| Malformed::Range("a worker's key"))
}

impl Recovered {
    /// The share of the picture that was done in the last pass, and the pass's number, from 0.
    #[must_use]
    pub fn share(&self) -> (f64, u32) {
        let Some((&pass, kept)) = self.passes.last_key_value() else { return (0.0, 0) };
        let done: u64 = kept.tiles.iter().map(|t| t.lease.region.area()).sum();
        (done as f64 / self.head.region.area() as f64, pass)
    }

    /// How many tiles there are.
    #[must_use]
    pub fn tiles(&self) -> u64 {
        self.passes.values().map(|p| p.tiles.len() as u64).sum()
    }
}
