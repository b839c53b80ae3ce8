//! The files of one command: none that is read is written, and none is written twice.

use std::path::{Path, PathBuf};

use super::exit::Failure;

/// A file and what it is for.
#[derive(Debug)]
struct Use {
    what: &'static str,
    path: PathBuf,
    identity: Identity,
}

/// What two names of one file have in common.
#[derive(Debug, PartialEq, Eq)]
enum Identity {
    /// Of a file that is there, links of both kinds followed.
    #[cfg(unix)]
    Node(u64, u64),
    /// Of a file that is not there yet: a name in a folder that is.
    Name(PathBuf),
}

impl Identity {
    /// `None` for what is no file, such as /dev/stdout, and what cannot be one.
    fn of(path: &Path) -> Option<Self> {
        match std::fs::metadata(path) {
            Ok(m) if !m.is_file() => None,
            #[cfg(unix)]
            Ok(m) => {
                use std::os::unix::fs::MetadataExt;
                Some(Self::Node(m.dev(), m.ino()))
            }
            #[cfg(not(unix))]
            Ok(_) => path.canonicalize().ok().map(Self::Name),
            Err(_) => {
                let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
                Some(Self::Name(folder.canonicalize().ok()?.join(path.file_name()?)))
            }
        }
    }
}

/// See the [module](self).
#[derive(Debug, Default)]
pub(crate) struct Files {
    read: Vec<Use>,
    written: Vec<Use>,
}

impl Files {
    /// Adds a file that is read.
    ///
    /// # Errors
    /// When it is to be written, too.
    pub(crate) fn reads(&mut self, what: &'static str, path: &Path) -> Result<(), Failure> {
        let Some(identity) = Identity::of(path) else { return Ok(()) };
        if let Some(written) = self.written.iter().find(|w| w.identity == identity) {
            return Err(overwritten(written, what));
        }
        self.read.push(Use { what, path: path.into(), identity });
        Ok(())
    }

    /// Adds a file that is written.
    ///
    /// # Errors
    /// When it is read, or written already.
    pub(crate) fn writes(&mut self, what: &'static str, path: &Path) -> Result<(), Failure> {
        let Some(identity) = Identity::of(path) else { return Ok(()) };
        let this = Use { what, path: path.into(), identity };
        if let Some(read) = self.read.iter().find(|r| r.identity == this.identity) {
            return Err(overwritten(&this, read.what));
        }
        if let Some(other) = self.written.iter().find(|w| w.identity == this.identity) {
            return Err(Failure::usage(format!(
                "'{}' cannot be both {} and {}: choose another name for one of them",
                path.display(),
                other.what,
                what
            )));
        }
        self.written.push(this);
        Ok(())
    }
}

fn overwritten(written: &Use, read: &str) -> Failure {
    Failure::usage(format!(
        "'{}' is {read}: it is not overwritten with {}; choose another name",
        written.path.display(),
        written.what
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_known_by_every_name() {
        let at = tempfile::tempdir().unwrap();
        let file = |name: &str| at.path().join(name);
        std::fs::write(file("a"), "").unwrap();
        std::fs::hard_link(file("a"), file("hard")).unwrap();
        std::fs::create_dir(file("folder")).unwrap();
        let mut files = Files::default();
        files.reads("the scene", &file("a")).unwrap();
        for name in ["a", "hard", "folder/../a"] {
            let refused = files.writes("the picture", &file(name)).unwrap_err().message;
            assert!(refused.contains("is the scene") && refused.contains("the picture"), "{refused}");
        }
        files.writes("the picture", &file("b")).unwrap();
        assert!(files.writes("the report", &file("folder/../b")).is_err());
        assert!(files.reads("a picture of the scene", &file("b")).is_err());
        files.writes("the report", Path::new("/dev/null")).unwrap();
        files.writes("the journal", Path::new("/dev/null")).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn symbolic_links_are_what_they_lead_to() {
        let at = tempfile::tempdir().unwrap();
        std::fs::write(at.path().join("a"), "").unwrap();
        std::os::unix::fs::symlink("a", at.path().join("link")).unwrap();
        let mut files = Files::default();
        files.reads("the scene", &at.path().join("a")).unwrap();
        assert!(files.writes("the picture", &at.path().join("link")).is_err());
    }
}
