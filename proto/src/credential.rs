//! Tokens, certificates and keys as users give them: in files, or as text.

use std::path::{Path, PathBuf};

use rustls_pki_types::pem::{self, PemObject};
use rustls_pki_types::{CertificateDer, PrivateKeyDer};

use crate::token::{NotAToken, Token};

/// Why a token, certificate or key cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CredentialError {
    /// A file or folder cannot be read or written.
    #[error("'{}': {source}", .path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file does not hold what it should.
    #[error("'{}' holds no {what}: {why}", .path.display())]
    Content {
        /// Which.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
        /// What is wrong with it.
        why: String,
    },
    /// A text that is no token.
    #[error("{from}: {source}")]
    Token {
        /// Where it was given.
        from: String,
        /// What is wrong with it.
        source: NotAToken,
    },
}

impl CredentialError {
    /// For what the system says of the file at `path`.
    pub fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::File { path: path.into(), source }
    }

    fn pem(path: &Path, what: &'static str, error: pem::Error) -> Self {
        match error {
            pem::Error::Io(source) => Self::File { path: path.into(), source },
            other => Self::Content { path: path.into(), what, why: other.to_string() },
        }
    }
}

/// The token that `text` is; `from` is what to call the place where it was given.
///
/// # Errors
/// When it is none.
pub fn token(text: &str, from: impl Into<String>) -> Result<Token, CredentialError> {
    text.parse().map_err(|source| CredentialError::Token { from: from.into(), source })
}

/// The certificates in a PEM file, in their order; at least one.
///
/// # Errors
/// When the file cannot be read or holds none.
pub fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, CredentialError> {
    let wrong = |e| CredentialError::pem(path, "certificate", e);
    let found: Vec<_> = CertificateDer::pem_file_iter(path).map_err(wrong)?.collect::<Result<_, _>>().map_err(wrong)?;
    if found.is_empty() { Err(wrong(pem::Error::NoItemsFound)) } else { Ok(found) }
}

/// The private key in a PEM file.
///
/// # Errors
/// When the file cannot be read or holds none.
pub fn private_key(path: &Path) -> Result<PrivateKeyDer<'static>, CredentialError> {
    PrivateKeyDer::from_pem_file(path).map_err(|e| CredentialError::pem(path, "private key", e))
}
