//! A token in a file, which may be renewed while a farm runs.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use tessera_proto::credential;
use tessera_proto::token::{Pin, Secret, Token};

use super::AccessError;
use super::state::{read_or_make, read_secret};

/// See the [module](self).
pub(super) struct TokenFile {
    path: PathBuf,
    pin: Pin,
    now: Mutex<(Secret, Option<Stamp>)>,
}

/// What changes with a file that is replaced.
type Stamp = (SystemTime, u64);

impl TokenFile {
    /// The token in the file, made on first use.
    pub(super) fn open(path: PathBuf, pin: Pin) -> Result<Self, AccessError> {
        let make = || Ok(Token { pin, secret: Secret::new()? }.reveal() + "\n");
        let text = read_or_make(&path, make)?;
        let secret = parse(&text, pin, &path)?;
        let file = Self { now: Mutex::new((secret, None)), path, pin };
        file.secret();
        Ok(file)
    }

    /// The secret as the file has it now; the last one where it cannot be read any more.
    pub(super) fn secret(&self) -> Secret {
        let stamp = std::fs::metadata(&self.path).and_then(|m| Ok((m.modified()?, m.len()))).ok();
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        if stamp != now.1 {
            match read_secret(&self.path).and_then(|text| parse(&text, self.pin, &self.path)) {
                Ok(secret) => now.0 = secret,
                Err(e) => tracing::warn!("the token stays as it was: {e}"),
            }
            now.1 = stamp;
        }
        now.0
    }
}

fn parse(text: &str, pin: Pin, path: &std::path::Path) -> Result<Secret, AccessError> {
    let from = format!("'{}'", path.display());
    let token = credential::token(text, &from)?;
    if token.pin == pin { Ok(token.secret) } else { Err(AccessError::OtherFarm { from }) }
}
