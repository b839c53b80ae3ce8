//! The thread that writes a journal. Whoever renders never waits for it: what the disk is too slow for, or
//! refuses, is not kept, and would be rendered again.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use bytes::Bytes;
use tessera_proto::convert::{Lease, TileDone};
use tessera_proto::identity::WorkerId;
use tessera_proto::journal::record::Kind;
use tessera_proto::journal::{self, Record};
use tessera_proto::{Attempt, LeaseId};

use super::frame::{MAGIC, put};
use super::head::Head;
use super::recover::ThrownOut;
use crate::progress::CheckedTile;

/// What is written is on the disk after this time, and the disk's own.
const SYNC_EVERY: Duration = Duration::from_millis(500);
/// Bytes of pixels that may wait to be written; what comes on top is not kept.
const PENDING: usize = 256 << 20;
/// So many bytes are written before the time has come for a journal.
const HELD: usize = 64 << 20;
/// Bytes that are written at once, about.
const AT_ONCE: usize = 256 << 10;
/// After the disk refused, it is asked again.
const RETRY_AFTER: Duration = Duration::from_secs(5);

/// What is to be kept.
enum Entry {
    Tile(Box<Accepted>),
    /// Of another kind, and short.
    Other(Box<Kind>),
}

/// A tile, by whom and when.
struct Accepted {
    lease: Lease,
    done: TileDone,
    by: Delivery,
}

/// Whose a tile is.
#[derive(Clone, Debug)]
pub(crate) struct Delivery {
    /// The worker's name.
    pub(crate) name: String,
    /// Since the render began.
    pub(crate) at: Duration,
    /// The worker's key and the sum of what it delivered, where tiles are verified.
    pub(crate) made: Option<(WorkerId, [u8; 32])>,
}

impl Entry {
    /// Memory that it takes, about.
    fn bytes(&self) -> usize {
        match self {
            Self::Tile(tile) => 256 + tile.done.pixels.len(),
            Self::Other(_) => 0,
        }
    }

    fn record(self) -> Record {
        let kind = match self {
            Self::Tile(tile) => {
                let Accepted { lease, done, by: Delivery { name: worker, at, made } } = *tile;
                let (key, sum_sha256) = made.map(|(key, sum)| (key.0.to_vec(), sum.to_vec())).unwrap_or_default();
                let (lease, done, at_us) = (Some(lease.into()), Some(done.into()), super::micros(at));
                Kind::Tile(journal::Tile { lease, done, worker, at_us, key, sum_sha256 })
            }
            Self::Other(kind) => *kind,
        };
        Record { kind: Some(kind) }
    }
}

/// Where tiles go that are to be kept. The journal's thread ends when it is dropped.
#[derive(Debug)]
pub(crate) struct Sink {
    entries: mpsc::Sender<Entry>,
    pending: Arc<AtomicUsize>,
    full: bool,
}

impl Sink {
    /// Keeps a tile: how it was rendered (ids do not matter), what came, by whom and when. Without `pixels` where
    /// they are not for the picture.
    pub(crate) fn tile(&mut self, lease: Lease, done: &TileDone, pixels: bool, by: Delivery) {
        let lease = Lease { id: LeaseId(0), attempt: Attempt(0), ..lease };
        let mut done = TileDone { lease: lease.id, attempt: lease.attempt, ..done.clone() };
        if !pixels {
            done.pixels = Bytes::new();
        }
        self.send(Entry::Tile(Box::new(Accepted { lease, done, by })));
    }

    /// Keeps the end of a pass.
    pub(crate) fn passed(&mut self, pass: u32, took: Duration, now: Duration) {
        let nanos = |d: Duration| u64::try_from(d.as_nanos()).unwrap_or(u64::MAX);
        let passed = journal::Passed { pass, took_ns: nanos(took), now_ns: nanos(now) };
        self.send(Entry::Other(Box::new(Kind::Passed(passed))));
    }

    /// Keeps that a tile of a pass was rendered twice, and whether it is `confirmed`.
    pub(crate) fn checked(&mut self, pass: u32, check: &CheckedTile, confirmed: bool) {
        let checked = journal::Checked {
            pass,
            region: Some(check.region.into()),
            made_by: check.maker.clone(),
            checked_by: check.checker.clone().unwrap_or_default(),
            agreed: check.agreed,
            confirmed,
        };
        self.send(Entry::Other(Box::new(Kind::Checked(checked))));
    }

    /// Keeps that a worker lied: what it made until now counts no more, unless it was confirmed.
    pub(crate) fn thrown_out(&mut self, out: &ThrownOut) {
        let ThrownOut { worker, name, rule, redone } = out.clone();
        self.send(Entry::Other(Box::new(Kind::ThrownOut(journal::ThrownOut {
            key: worker.0.to_vec(),
            name,
            rule,
            redone,
        }))));
    }

    fn send(&mut self, entry: Entry) {
        let bytes = entry.bytes();
        if self.pending.fetch_add(bytes, Ordering::Relaxed) + bytes > PENDING && bytes > 0 {
            self.pending.fetch_sub(bytes, Ordering::Relaxed);
            if !std::mem::replace(&mut self.full, true) {
                tracing::warn!("the journal's disk is slower than the farm: some of what is done is not kept");
            }
            return;
        }
        // Its thread ends early only where it can keep nothing, and has said so.
        let _ = self.entries.send(entry);
    }
}

/// How a journal begins.
pub(super) enum Begin {
    /// As a new file, at this time.
    New { at: Instant, head: Box<dyn FnOnce() -> Head + Send> },
    /// Behind what stands in this one.
    Behind { file: File, end: u64 },
}

/// A journal's thread, and what it is told beside what to keep.
#[derive(Debug)]
pub(super) struct Thread {
    thread: std::thread::JoinHandle<()>,
    discard: Arc<AtomicBool>,
    exists: Arc<AtomicBool>,
}

impl Thread {
    /// Waits until all is written, which begins when its [`Sink`] is dropped; gives whether there is a file.
    pub(super) fn end(self) -> bool {
        // It does not panic; if it did, what it wrote until then is there.
        let _ = self.thread.join();
        self.exists.load(Ordering::Acquire)
    }

    /// What is not written need not be any more.
    pub(super) fn discard(&self) {
        self.discard.store(true, Ordering::Release);
    }
}

/// Starts a journal's thread.
pub(super) fn start(path: &Path, begin: Begin) -> io::Result<(Sink, Thread)> {
    let (entries, heard) = mpsc::channel();
    let (pending, discard, exists) = (Arc::default(), Arc::default(), Arc::default());
    let mut writer = Writer {
        path: path.into(),
        pending: Arc::clone(&pending),
        discard: Arc::clone(&discard),
        exists: Arc::clone(&exists),
        held: Vec::new(),
        held_bytes: 0,
        state: State::Waiting(None),
        buffer: Vec::new(),
        vital: false,
    };
    let run = move || {
        match begin {
            Begin::New { at, head } => writer.state = State::Waiting(Some((at, head))),
            Begin::Behind { mut file, end } => {
                // What stands behind is a tail that never got to the disk.
                let cut = file.set_len(end).and_then(|()| file.seek(SeekFrom::Start(end)));
                writer.exists.store(true, Ordering::Release);
                writer.state = State::Open(Out::new(file, end));
                if let Err(e) = cut {
                    writer.refused(&e);
                }
            }
        }
        writer.run(&heard);
    };
    let thread = std::thread::Builder::new().name("journal".into()).spawn(run)?;
    Ok((Sink { entries, pending, full: false }, Thread { thread, discard, exists }))
}

/// A file that is being written.
struct Out {
    file: File,
    /// The end of what is written whole.
    end: u64,
    /// The end of what is on the disk.
    synced: u64,
    sync_at: Option<Instant>,
    /// The disk refused: nothing is written before this time.
    retry_at: Option<Instant>,
    folder_synced: bool,
}

impl Out {
    /// Written up to `end`, and none of it known to be on the disk.
    fn new(file: File, end: u64) -> Self {
        Self { file, end, synced: 0, sync_at: None, retry_at: None, folder_synced: false }
    }
}

enum State {
    /// For its time to come.
    Waiting(Option<(Instant, Box<dyn FnOnce() -> Head + Send>)>),
    Open(Out),
    /// There is no keeping anything here.
    Dead,
}

struct Writer {
    path: PathBuf,
    pending: Arc<AtomicUsize>,
    discard: Arc<AtomicBool>,
    exists: Arc<AtomicBool>,
    held: Vec<Entry>,
    held_bytes: usize,
    state: State,
    buffer: Vec<u8>,
    /// Whether a record is among them without which the file would be worse than none.
    vital: bool,
}

impl Writer {
    fn run(mut self, entries: &Receiver<Entry>) {
        loop {
            match entries.recv_timeout(self.wait()) {
                Ok(entry) => {
                    self.take(entry);
                    while self.buffer.len() < AT_ONCE
                        && let Ok(entry) = entries.try_recv()
                    {
                        self.take(entry);
                    }
                    self.write();
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            self.open_if_due();
            self.sync_if_due(Instant::now());
        }
        if !self.discard.load(Ordering::Acquire) {
            self.sync();
        }
    }

    /// Until something is to be done without being told.
    fn wait(&self) -> Duration {
        let at = match &self.state {
            State::Waiting(Some((at, _))) => Some(*at).filter(|at| !self.held.is_empty() || Instant::now() < *at),
            State::Open(out) => out.sync_at,
            _ => None,
        };
        at.map_or(Duration::from_secs(3600), |at| at.saturating_duration_since(Instant::now()))
    }

    fn take(&mut self, entry: Entry) {
        let bytes = entry.bytes();
        let is_vital = matches!(&entry, Entry::Other(kind) if matches!(**kind, Kind::ThrownOut(_)));
        match &mut self.state {
            State::Waiting(_) => {
                self.held_bytes += bytes;
                self.held.push(entry);
                return;
            }
            State::Open(out) if is_vital || out.retry_at.is_none_or(|at| Instant::now() >= at) => {
                self.vital |= is_vital;
                put(&mut self.buffer, &entry.record(), out.synced);
            }
            State::Open(_) | State::Dead => {}
        }
        self.pending.fetch_sub(bytes, Ordering::Relaxed);
    }

    /// Begins the file when its time has come and there is something to keep, or sooner where that is much.
    fn open_if_due(&mut self) {
        let State::Waiting(due) = &mut self.state else { return };
        let is_due = |at: Instant| !self.held.is_empty() && Instant::now() >= at;
        let Some((_, head)) = due.take_if(|(at, _)| is_due(*at) || self.held_bytes > HELD) else { return };
        self.state = match create(&self.path) {
            Ok(file) => {
                self.exists.store(true, Ordering::Release);
                tracing::info!(file = %self.path.display(), "what is done is kept from now on");
                self.buffer.extend_from_slice(MAGIC);
                let record = Record { kind: Some(Kind::Head(head().into())) };
                put(&mut self.buffer, &record, 0);
                State::Open(Out::new(file, 0))
            }
            Err(e) => {
                tracing::warn!("cannot keep what is done in '{}': {e}; going on without", self.path.display());
                State::Dead
            }
        };
        for entry in std::mem::take(&mut self.held) {
            self.take(entry);
            if self.buffer.len() >= AT_ONCE {
                self.write();
            }
        }
        self.write();
    }

    /// Writes what was taken.
    fn write(&mut self) {
        let State::Open(out) = &mut self.state else { return };
        if self.buffer.is_empty() {
            return;
        }
        match out.file.write_all(&self.buffer) {
            Ok(()) => {
                out.end += self.buffer.len() as u64;
                out.retry_at = None;
                let wait = if self.vital { Duration::ZERO } else { SYNC_EVERY };
                let sync_at = Instant::now() + wait;
                out.sync_at = Some(out.sync_at.map_or(sync_at, |at| at.min(sync_at)));
            }
            Err(e) if self.vital => self.renounce(&e),
            Err(e) => self.refused(&e),
        }
        self.vital = false;
        self.buffer.clear();
    }

    fn sync_if_due(&mut self, now: Instant) {
        if let State::Open(out) = &self.state
            && out.sync_at.is_some_and(|at| now >= at)
        {
            self.sync();
        }
    }

    fn sync(&mut self) {
        let State::Open(out) = &mut self.state else { return };
        out.sync_at = None;
        if out.synced == out.end {
            return;
        }
        match out.file.sync_data() {
            Ok(()) => {
                out.synced = out.end;
                if !std::mem::replace(&mut out.folder_synced, true) {
                    sync_folder(&self.path);
                }
            }
            Err(e) => self.refused(&e),
        }
    }

    /// The disk refused what takes back what is in the file: who went on from that would have a liar's pixels.
    fn renounce(&mut self, e: &io::Error) {
        tracing::warn!(
            "cannot write '{}': {e}; it is removed, since it holds what was found to be wrong",
            self.path.display()
        );
        if let State::Open(out) = &self.state {
            // Also where the name cannot be removed.
            let _ = out.file.set_len(0);
        }
        let _ = std::fs::remove_file(&self.path);
        self.exists.store(false, Ordering::Release);
        self.state = State::Dead;
    }

    /// The disk refused: the file ends with what is whole, and what comes in the next while is not kept.
    fn refused(&mut self, e: &io::Error) {
        let State::Open(out) = &mut self.state else { return };
        let ended = out.file.set_len(out.end).and_then(|()| out.file.seek(SeekFrom::Start(out.end)));
        if out.retry_at.is_none() {
            tracing::warn!("cannot write '{}': {e}; what is done now is not kept there", self.path.display());
        }
        out.retry_at = Some(Instant::now() + RETRY_AFTER);
        if out.end == 0 {
            // Not even its beginning: nothing is there to go on from.
            let _ = std::fs::remove_file(&self.path);
            self.exists.store(false, Ordering::Release);
        }
        if ended.is_err() || out.end == 0 {
            self.state = State::Dead;
        }
    }
}

/// A new file that nobody else writes.
fn create(path: &Path) -> io::Result<File> {
    let file = OpenOptions::new().read(true).write(true).create_new(true).open(path)?;
    // Where files cannot be locked there is no telling who else writes.
    let _ = file.try_lock();
    Ok(file)
}

/// Makes sure that the file's name is on the disk, where the system can.
fn sync_folder(path: &Path) {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}
