//! A file that appears under its name only when it is whole.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

/// Temporary files of this process, for an end that drops nothing.
static LIVE: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Removes every temporary file of this process: to be called before an exit that drops nothing.
pub fn remove_temporaries() {
    for path in std::mem::take(&mut *LIVE.lock().unwrap_or_else(PoisonError::into_inner)) {
        let _ = std::fs::remove_file(path);
    }
}

/// A temporary file beside its target; gone when dropped, unless it was [kept](Self::keep). Its process holds a lock
/// on it, so that others know that it is not a leftover.
#[derive(Debug)]
pub(super) struct Temporary {
    file: Option<File>,
    path: PathBuf,
}

/// The beginning of the names of `target`'s temporary files.
fn prefix(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    // A long name leaves no room for more: its first letters are enough to know it by.
    let name: String = name.chars().take(40).collect();
    format!(".{name}.")
}

impl Temporary {
    /// A new, empty file in the folder of `target`.
    pub(super) fn beside(target: &Path) -> io::Result<Self> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let prefix = prefix(target);
        loop {
            let n = NUMBER.fetch_add(1, Ordering::Relaxed);
            let path = target.with_file_name(format!("{prefix}{}-{n}.tmp", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => {
                    // Where files cannot be locked, leftovers stay.
                    let taken = matches!(file.try_lock(), Err(TryLockError::WouldBlock));
                    // Before it was locked it may have been taken for a leftover.
                    if !taken && is_at(&file, &path) {
                        LIVE.lock().unwrap_or_else(PoisonError::into_inner).insert(path.clone());
                        return Ok(Self { file: Some(file), path });
                    }
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
            }
        }
    }

    /// Removes what processes that were killed left of `target`.
    pub(super) fn clear_leftovers(target: &Path) {
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let prefix = prefix(target);
        let ours = |name: &str| {
            let number = name.strip_prefix(&prefix).and_then(|n| n.strip_suffix(".tmp"));
            let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            number.and_then(|n| n.split_once('-')).is_some_and(|(id, n)| digits(id) && digits(n))
        };
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            if !entry.file_name().to_str().is_some_and(ours) {
                continue;
            }
            let path = entry.path();
            // Whoever writes it holds its lock.
            if let Ok(file) = OpenOptions::new().write(true).open(&path)
                && file.try_lock().is_ok()
            {
                let _ = std::fs::remove_file(&path);
            }
        }
    }

    /// The file to write to.
    pub(super) fn file(&mut self) -> &mut File {
        self.file.as_mut().unwrap_or_else(|| unreachable!("taken by keep and drop only"))
    }

    /// Takes `bytes` of the disk for the file, which is then so long; gives whether they are sure to be had later.
    ///
    /// # Errors
    /// [`io::ErrorKind::StorageFull`], [`io::ErrorKind::QuotaExceeded`] or [`io::ErrorKind::FileTooLarge`] where the
    /// disk has no room for them.
    #[cfg(target_os = "linux")]
    pub(super) fn reserve(&mut self, bytes: u64) -> io::Result<bool> {
        use rustix::fs::{FallocateFlags, fallocate};
        match fallocate(self.file(), FallocateFlags::empty(), 0, bytes).map_err(io::Error::from) {
            Ok(()) => Ok(true),
            Err(e) if is_no_room(&e) => Err(e),
            // Not every file system can.
            Err(_) => Ok(false),
        }
    }

    /// Nothing is known of room here.
    #[cfg(not(target_os = "linux"))]
    pub(super) fn reserve(&mut self, _: u64) -> io::Result<bool> {
        Ok(false)
    }

    /// Gives it the name `target`, in place of what bore that name.
    pub(super) fn keep(mut self, target: &Path) -> io::Result<()> {
        // Closed first: some systems do not rename open files.
        self.file = None;
        std::fs::rename(&self.path, target)?;
        LIVE.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.path);
        self.path = PathBuf::new();
        Ok(())
    }
}

/// Whether `e` says that the disk has no room.
pub(super) fn is_no_room(e: &io::Error) -> bool {
    use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    matches!(e.kind(), StorageFull | QuotaExceeded | FileTooLarge)
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |m: std::fs::Metadata| (m.dev(), m.ino());
    file.metadata().map(id).ok() == std::fs::metadata(path).map(id).ok()
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

impl Drop for Temporary {
    fn drop(&mut self) {
        self.file = None;
        if !self.path.as_os_str().is_empty() {
            // Nothing can be done about it, and the cause has been reported already.
            let _ = std::fs::remove_file(&self.path);
            LIVE.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.path);
        }
    }
}
