//! The farm's folder: a database of jobs, and files of scenes, journals and pictures, named by their content.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use prost::Message;
use redb::{Database, ReadableDatabase, ReadableTable, TableDefinition};
use sha2::{Digest, Sha256};
use tessera_proto::SceneHash;
use tessera_proto::control::Job;

use crate::film::Film;

/// Jobs by their numbers.
const JOBS: TableDefinition<'_, u64, &[u8]> = TableDefinition::new("jobs");
/// The format of what is here, and the next job's number.
const META: TableDefinition<'_, &str, u64> = TableDefinition::new("meta");
const FORMAT: u64 = 1;
/// Memory that the database may take for what it read.
const CACHE: usize = 8 << 20;

/// Why a farm's folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The system refused.
    #[error("the farm's folder '{}' cannot be used: {}", .0.display(), .1)]
    Io(PathBuf, io::Error),
    /// Another farm is at work on it.
    #[error("another farm is at work on '{}'", .0.display())]
    Busy(PathBuf),
    /// Its database is damaged, or cannot be written.
    #[error("the farm's state in '{}' cannot be used: {}", .0.display(), .1)]
    Database(PathBuf, String),
    /// Another release made it.
    #[error("the farm's state in '{}' is of another release of this program", .0.display())]
    Format(PathBuf),
}

/// See the [module](self).
pub(super) struct Store {
    db: Database,
    folder: PathBuf,
}

/// What an earlier run left.
#[derive(Debug, Default)]
pub(super) struct Left {
    pub(super) jobs: Vec<Job>,
    pub(super) next_id: u64,
}

impl Store {
    /// Opens `folder`, which is made where it is missing.
    pub(super) fn open(folder: &Path) -> Result<(Self, Left), StoreError> {
        let failed = |e| StoreError::Io(folder.into(), e);
        for sub in ["scenes", "journals", "pictures"] {
            fs::create_dir_all(folder.join(sub)).map_err(failed)?;
        }
        let file = folder.join("queue.redb");
        let database = |e: redb::Error| match e {
            redb::Error::DatabaseAlreadyOpen => StoreError::Busy(folder.into()),
            e => StoreError::Database(folder.into(), e.to_string()),
        };
        let db = redb::Builder::new().set_cache_size(CACHE).create(&file).map_err(|e| database(e.into()))?;
        let store = Self { db, folder: folder.into() };
        let left = store.read().map_err(database)?;
        let left = left.ok_or_else(|| StoreError::Format(folder.into()))?;
        store.tidy();
        Ok((store, left))
    }

    /// All that is kept; `None` where it is of another format.
    fn read(&self) -> Result<Option<Left>, redb::Error> {
        let write = self.db.begin_write()?;
        {
            let mut meta = write.open_table(META)?;
            let format = meta.get("format")?.map(|v| v.value());
            match format {
                None => drop(meta.insert("format", FORMAT)?),
                Some(FORMAT) => {}
                Some(_) => return Ok(None),
            }
            write.open_table(JOBS)?;
        }
        write.commit()?;
        let read = self.db.begin_read()?;
        let next_id = read.open_table(META)?.get("next")?.map_or(1, |v| v.value());
        let mut jobs = Vec::new();
        for row in read.open_table(JOBS)?.iter()? {
            let (id, bytes) = row?;
            match Job::decode(bytes.value()) {
                Ok(job) => jobs.push(job),
                Err(e) => tracing::error!("job {} cannot be read any more: {e}", id.value()),
            }
        }
        Ok(Some(Left { jobs, next_id }))
    }

    /// Clears away what a crash left half written.
    fn tidy(&self) {
        for sub in ["scenes", "pictures"] {
            let Ok(entries) = fs::read_dir(self.folder.join(sub)) else { continue };
            for entry in entries.flatten().filter(|e| e.path().extension().is_none_or(|e| e == "tmp")) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    /// Keeps a job as it is now; it is on the disk afterwards. `next_id` is the next one's number.
    pub(super) fn put(&self, job: &Job, next_id: u64) -> Result<(), redb::Error> {
        let write = self.db.begin_write()?;
        {
            let bytes = job.encode_to_vec();
            write.open_table(JOBS)?.insert(job.id, bytes.as_slice())?;
            write.open_table(META)?.insert("next", next_id)?;
        }
        Ok(write.commit()?)
    }

    /// Forgets jobs.
    pub(super) fn remove(&self, ids: &[u64]) -> Result<(), redb::Error> {
        let write = self.db.begin_write()?;
        {
            let mut jobs = write.open_table(JOBS)?;
            for id in ids {
                jobs.remove(id)?;
            }
        }
        Ok(write.commit()?)
    }

    pub(super) fn scene(&self, hash: SceneHash) -> PathBuf {
        self.folder.join("scenes").join(hex(&hash.0) + ".scene")
    }

    pub(super) fn journal(&self, id: u64) -> PathBuf {
        self.folder.join("journals").join(format!("{id}.journal"))
    }

    pub(super) fn pixels(&self, hash: [u8; 32]) -> PathBuf {
        self.folder.join("pictures").join(hex(&hash) + ".pixels")
    }

    /// Keeps the pixels of a picture; they are on the disk afterwards. Gives their hash.
    pub(super) fn put_pixels(&self, film: &Film) -> io::Result<[u8; 32]> {
        let (mut sum, mut length) = (Sha256::new(), 0);
        film.for_bytes(|bytes| {
            sum.update(bytes);
            length += bytes.len() as u64;
            Ok(())
        })?;
        let hash: [u8; 32] = sum.finalize().into();
        let path = self.pixels(hash);
        if fs::metadata(&path).is_ok_and(|m| m.len() == length) {
            return Ok(hash);
        }
        write_whole(&path, |file| film.for_bytes(|bytes| file.write_all(bytes)))?;
        Ok(hash)
    }
}

/// Writes a file that has its name only when it is whole and on the disk.
pub(crate) fn write_whole<T>(path: &Path, write: impl FnOnce(&mut fs::File) -> io::Result<T>) -> io::Result<T> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut file = tempfile::Builder::new().suffix(".tmp").tempfile_in(folder)?;
    let written = write(file.as_file_mut())?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|e| e.error)?;
    // Its name, too, has to outlast a loss of power.
    fs::File::open(folder)?.sync_all()?;
    Ok(written)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}
