//! What is done of a picture, kept in a file from where a render goes on.
//!
//! `journal.proto` is the file's specification. Tiles go into it as they are accepted, written by a thread of its
//! own and on the disk within a second. [`Journal::open`] reads what an earlier run left; the farm then tells the
//! plan of it as if it had just been delivered, and leases what is missing.

mod frame;
mod head;
mod partial;
mod recover;
mod rest;
#[cfg(test)]
mod tests;
mod writer;

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;
use tessera_proto::journal::record::Kind;

pub(crate) use frame::Location;
pub use head::Head;
pub use partial::Partial;
#[cfg(test)]
pub(crate) use recover::Made;
pub use recover::{JournalError, Recovered};
pub(crate) use recover::{Kept, KeptPass, ThrownOut, Verified};
pub(crate) use rest::rest;
use writer::{Begin, Thread};
pub(crate) use writer::{Delivery, Sink};

/// A render shorter than this leaves no trace on the disk.
const AFTER: Duration = Duration::from_secs(2);

/// Where a render's journal is, and what an earlier run left there.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    /// How long a render lasts before a file is made.
    after: Duration,
    recovered: Mutex<Option<Recovered>>,
    thread: Mutex<Option<Thread>>,
}

/// What an earlier run left.
#[derive(Debug)]
pub(crate) struct Found {
    /// Where pixels are read from.
    pub(crate) reader: File,
    pub(crate) passes: BTreeMap<u32, KeptPass>,
    pub(crate) verified: Verified,
    /// Time that was rendered for, over all runs.
    pub(crate) spent: Duration,
}

impl Journal {
    /// The journal at `path`, read if it is there. With `restart` what is there is removed instead.
    ///
    /// # Errors
    /// When what is there is no journal or damaged, or another process writes it.
    pub fn open(path: &Path, restart: bool) -> Result<Self, JournalError> {
        let mut journal =
            Self { path: path.into(), after: AFTER, recovered: Mutex::default(), thread: Mutex::default() };
        let Some(file) = recover::open(path)? else { return Ok(journal) };
        let read = recover::read(file, path);
        let gone = |e| JournalError::Io(path.into(), e);
        match read {
            Err(e @ (JournalError::Foreign(_) | JournalError::Io(..))) => return Err(e),
            _ if restart => std::fs::remove_file(path).map_err(gone)?,
            Err(e) => return Err(e),
            // Nothing was done yet.
            Ok(None) => std::fs::remove_file(path).map_err(gone)?,
            Ok(Some(recovered)) if recovered.damaged => {
                return Err(JournalError::Damaged { path: path.into(), at: recovered.end });
            }
            Ok(Some(recovered)) => journal.recovered = Mutex::new(Some(recovered)),
        }
        Ok(journal)
    }

    /// Begins the file so long after a render's beginning, instead of after two seconds.
    #[must_use]
    pub fn after(self, after: Duration) -> Self {
        Self { after, ..self }
    }

    /// Its file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether an earlier run left something.
    #[must_use]
    pub fn goes_on(&self) -> bool {
        self.recovered.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// The share of the picture that was done in the last pass, and the pass's number, from 0.
    #[must_use]
    pub fn share(&self) -> Option<(f64, u32)> {
        self.recovered.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map(Recovered::share)
    }

    /// Makes sure that what was left is of the picture that `now` is.
    ///
    /// # Errors
    /// [`JournalError::Other`] names what is not the same.
    pub fn check(&self, now: &Head) -> Result<(), JournalError> {
        let recovered = self.recovered.lock().unwrap_or_else(PoisonError::into_inner);
        let differences = recovered.as_ref().map_or_else(Vec::new, |r| r.head.differences(now));
        if differences.is_empty() { Ok(()) } else { Err(JournalError::Other { path: self.path.clone(), differences }) }
    }

    /// Starts keeping what is done, and gives what an earlier run left. `head` is asked for when a file is begun.
    /// Without a sink nothing can be kept.
    pub(crate) fn start(&self, head: impl FnOnce() -> Head + Send + 'static) -> (Option<Sink>, Option<Found>) {
        let recovered = self.recovered.lock().unwrap_or_else(PoisonError::into_inner).take();
        let (begin, found) = match recovered {
            Some(Recovered { file, end, reader, passes, verified, spent, .. }) => {
                (Begin::Behind { file, end }, Some(Found { reader, passes, verified, spent }))
            }
            None => (Begin::New { at: Instant::now() + self.after, head: Box::new(head) }, None),
        };
        match writer::start(&self.path, begin) {
            Ok((sink, thread)) => {
                *self.thread.lock().unwrap_or_else(PoisonError::into_inner) = Some(thread);
                (Some(sink), found)
            }
            Err(e) => {
                tracing::warn!("cannot keep what is done in '{}': {e}", self.path.display());
                (None, found)
            }
        }
    }

    /// Waits until all that was done is on the disk; gives the file, if there is one. To be called after the render.
    #[must_use]
    pub fn kept(&self) -> Option<&Path> {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        let kept = thread.map_or_else(|| self.goes_on(), Thread::end);
        kept.then_some(&*self.path)
    }

    /// Removes the file: the picture is in its place. To be called after the render.
    pub fn remove(&self) {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(thread) = thread else { return };
        thread.discard();
        if thread.end()
            && let Err(e) = std::fs::remove_file(&self.path)
            && e.kind() != std::io::ErrorKind::NotFound
        {
            tracing::warn!("cannot remove the journal '{}', which is not needed any more: {e}", self.path.display());
        }
    }
}

/// The pixels of the tile that stands at `place`.
pub(crate) fn pixels(file: &File, place: Location) -> std::io::Result<Bytes> {
    match frame::read_again(file, place)?.kind {
        Some(Kind::Tile(tile)) => Ok(tile.done.unwrap_or_default().pixels),
        _ => Err(std::io::Error::other("the journal changed")),
    }
}

/// In whole microseconds.
fn micros(d: Duration) -> u64 {
    u64::try_from(d.as_micros()).unwrap_or(u64::MAX)
}
