//! A file that appears under its name only when it is whole.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// A temporary file beside its target; gone when dropped, unless it was [kept](Self::keep).
#[derive(Debug)]
pub(super) struct Temporary {
    file: Option<File>,
    path: PathBuf,
}

impl Temporary {
    /// A new, empty file in the folder of `target`.
    pub(super) fn beside(target: &Path) -> io::Result<Self> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        // A long name leaves no room for more: its first letters are enough to know it by.
        let name: String = name.chars().take(40).collect();
        loop {
            let n = NUMBER.fetch_add(1, Ordering::Relaxed);
            let path = target.with_file_name(format!(".{name}.{}-{n}.tmp", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => return Ok(Self { file: Some(file), path }),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
            }
        }
    }

    /// The file to write to.
    pub(super) fn file(&mut self) -> &mut File {
        self.file.as_mut().unwrap_or_else(|| unreachable!("taken by keep and drop only"))
    }

    /// Gives it the name `target`, in place of what bore that name.
    pub(super) fn keep(mut self, target: &Path) -> io::Result<()> {
        // Closed first: some systems do not rename open files.
        self.file = None;
        std::fs::rename(&self.path, target)?;
        self.path = PathBuf::new();
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        self.file = None;
        if !self.path.as_os_str().is_empty() {
            // Nothing can be done about it, and the cause has been reported already.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}
