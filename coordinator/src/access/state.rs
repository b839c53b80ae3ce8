//! The folder where a user's authority and token are kept.

use std::io::Write;
use std::path::{Path, PathBuf};

use tessera_proto::credential::CredentialError;
use tessera_proto::token::{Pin, Secret, Token};

use super::{AccessError, Authority, TokenFile};

/// The authority's certificate and key.
const AUTHORITY: &str = "authority.pem";
/// The workers' token.
const TOKEN: &str = "token";

/// The users' token.
const USER_TOKEN: &str = "user-token";

/// The folder in which the farm keeps its keys and secrets.
#[derive(Clone, Debug)]
pub struct State {
    folder: PathBuf,
}

impl State {
    /// This user's: `tessera` in `XDG_STATE_HOME`, or else in `~/.local/state`.
    ///
    /// # Errors
    /// When the environment names neither.
    pub fn of_user() -> Result<Self, AccessError> {
        let named = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
        let base = named("XDG_STATE_HOME").or_else(|| Some(named("HOME")?.join(".local/state")));
        Ok(Self::at(base.ok_or(AccessError::NoHome)?.join("tessera")))
    }

    /// Another place.
    #[must_use]
    pub fn at(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Where the token is.
    #[must_use]
    pub fn token_path(&self) -> PathBuf {
        self.folder.join(TOKEN)
    }

    /// All files of it, and what each is.
    #[must_use]
    pub fn files(&self) -> [(&'static str, PathBuf); 3] {
        let authority = self.folder.join(AUTHORITY);
        [("this user's authority", authority), ("the token", self.token_path()), ("the token", self.user_token_path())]
    }

    /// Where the users' token is.
    #[must_use]
    pub fn user_token_path(&self) -> PathBuf {
        self.folder.join(USER_TOKEN)
    }

    /// The users' token; made on first use.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub fn user_token(&self) -> Result<Token, AccessError> {
        let pin = self.authority()?.pin();
        Ok(Token { pin, secret: TokenFile::open(self.user_token_path(), pin)?.secret() })
    }

    /// Makes another users' token. The one before lets nobody in any more.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn renew_user_token(&self) -> Result<Token, AccessError> {
        self.renew(&self.user_token_path())
    }

    /// Where the token for a certificate that is not the authority's is.
    pub(crate) fn token_path_for(&self, pin: Pin) -> PathBuf {
        self.folder.join(format!("{TOKEN}-{pin:?}"))
    }

    /// The token; made on first use.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub fn token(&self) -> Result<Token, AccessError> {
        let pin = self.authority()?.pin();
        Ok(Token { pin, secret: TokenFile::open(self.token_path(), pin)?.secret() })
    }

    /// Makes another token. The one before lets nobody in any more; whoever is in stays.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn renew_token(&self) -> Result<Token, AccessError> {
        self.renew(&self.token_path())
    }

    fn renew(&self, path: &Path) -> Result<Token, AccessError> {
        let token = Token { pin: self.authority()?.pin(), secret: Secret::new()? };
        write_secret(path, &(token.reveal() + "\n"), |file| file.persist(path).map_err(|e| e.error))?;
        Ok(token)
    }

    /// The authority; made on first use.
    pub(crate) fn authority(&self) -> Result<Authority, AccessError> {
        let path = self.folder.join(AUTHORITY);
        let text = read_or_make(&path, || Authority::make().map_err(|e| AccessError::Tls(e.to_string())))?;
        Authority::read(&text).map_err(|why| CredentialError::Content { path, what: "certificate and key", why }.into())
    }
}

/// The text of a secret file. Where it is missing, what `make` gives is written first; of several programs that
/// do so at once, all get the same.
pub(super) fn read_or_make(
    path: &Path,
    make: impl FnOnce() -> Result<String, AccessError>,
) -> Result<String, AccessError> {
    match read_secret(path) {
        Err(AccessError::Credential(CredentialError::File { source, .. }))
            if source.kind() == std::io::ErrorKind::NotFound => {}
        read => return read,
    }
    let text = make()?;
    write_secret(path, &text, |file| match file.persist_noclobber(path) {
        Err(e) if e.error.kind() == std::io::ErrorKind::AlreadyExists => Ok(()),
        done => done.map(drop).map_err(|e| e.error),
    })?;
    read_secret(path)
}

/// Reads a file that only its owner may read.
pub(super) fn read_secret(path: &Path) -> Result<String, AccessError> {
    let wrong = |source| CredentialError::File { path: path.into(), source };
    let file = std::fs::File::open(path).map_err(wrong)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let found = file.metadata().map_err(wrong)?;
        // Of the administrator, for a group of this process: so a cluster hands secrets over.
        let handed = found.uid() == 0 && !rustix::process::geteuid().is_root() && found.mode() & 0o037 == 0;
        if found.mode() & 0o077 != 0 && !handed {
            return Err(AccessError::Exposed { path: path.into() });
        }
    }
    // Longer than any of them is.
    let mut text = String::new();
    std::io::Read::read_to_string(&mut std::io::Read::take(file, 1 << 20), &mut text).map_err(wrong)?;
    Ok(text)
}

/// Writes a file that only its owner may read, whole before it has its name.
fn write_secret<T>(
    path: &Path,
    text: &str,
    persist: impl FnOnce(tempfile::NamedTempFile) -> std::io::Result<T>,
) -> Result<(), AccessError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder).map_err(CredentialError::file(folder))?;
    let write = || {
        // The mode of such a file is 0600 from its beginning.
        let mut file = tempfile::NamedTempFile::new_in(folder)?;
        file.write_all(text.as_bytes())?;
        file.as_file().sync_all()?;
        persist(file)
    };
    Ok(write().map(drop).map_err(CredentialError::file(path))?)
}
