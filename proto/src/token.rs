//! What lets a worker in: a token that names the farm's certificate and holds a secret.
//!
//! As text it is `tessera1.PIN.SECRET`, both parts in unpadded URL-safe base 64. With the pin the worker
//! knows the coordinator, with the secret the coordinator knows the worker; nothing else has to be installed.

use std::fmt;
use std::str::FromStr;

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use ring::rand::{SecureRandom, SystemRandom};
use sha2::{Digest, Sha256};

/// What a token begins with; changes with its form.
const PREFIX: &str = "tessera1";

/// The name that a farm's own certificates are made out to, whatever host it runs on: the token names the
/// certificate, so the host's name proves nothing more. Nobody can be given this name elsewhere (RFC 2606).
pub const FARM_NAME: &str = "coordinator.tessera.invalid";

/// Metadata of a refusal that is meant for good. Other services do not know it, so whatever else answers at
/// the port does not end a worker.
pub const REFUSED_KEY: &str = "tessera-refused";

/// `N` bytes of the system's generator.
///
/// # Errors
/// When the system has none.
pub fn random<const N: usize>() -> Result<[u8; N], NoRandomness> {
    let mut bytes = [0; N];
    SystemRandom::new().fill(&mut bytes).map_err(|_| NoRandomness)?;
    Ok(bytes)
}

/// The system's generator of random numbers fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("this system gives no random numbers")]
pub struct NoRandomness;

/// A shared secret. It is compared in constant time and never shown by accident.
#[derive(Clone, Copy)]
pub struct Secret([u8; 16]);

impl Secret {
    /// A new one.
    ///
    /// # Errors
    /// When the system has no randomness.
    pub fn new() -> Result<Self, NoRandomness> {
        random().map(Self)
    }

    /// As it travels inside this process' own registrations.
    #[must_use]
    pub fn bytes(&self) -> [u8; 16] {
        self.0
    }

    /// As it travels: in the metadata of a call.
    #[must_use]
    pub fn reveal(&self) -> String {
        URL_SAFE_NO_PAD.encode(self.0)
    }

    /// What [`Secret::reveal`] gave; `None` where it cannot be that.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        // No longer than a secret is, so that decoding costs no more.
        let bytes = if text.len() == 22 { URL_SAFE_NO_PAD.decode(text).ok()? } else { return None };
        bytes.try_into().ok().map(Self)
    }
}

impl From<[u8; 16]> for Secret {
    fn from(bytes: [u8; 16]) -> Self {
        Self(bytes)
    }
}

impl PartialEq for Secret {
    fn eq(&self, other: &Self) -> bool {
        // No early end: how long it takes tells nothing of where they differ.
        let differ = self.0.iter().zip(&other.0).fold(0, |all, (a, b)| std::hint::black_box(all | (a ^ b)));
        differ == 0
    }
}

impl Eq for Secret {}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(…)")
    }
}

/// SHA-256 over a certificate.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Pin(pub [u8; 32]);

impl Pin {
    /// The pin of the certificate whose DER form this is.
    #[must_use]
    pub fn of(der: &[u8]) -> Self {
        Self(Sha256::digest(der).into())
    }
}

impl fmt::Debug for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0[..8].iter().try_for_each(|b| write!(f, "{b:02x}"))
    }
}

/// See the [module](self). `Debug` shows the pin alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Token {
    /// The certificate that the coordinator has, or that signed the coordinator's.
    pub pin: Pin,
    /// What the coordinator knows the worker by.
    pub secret: Secret,
}

impl Token {
    /// The token as text: whoever sees it may join.
    #[must_use]
    pub fn reveal(&self) -> String {
        format!("{PREFIX}.{}.{}", URL_SAFE_NO_PAD.encode(self.pin.0), self.secret.reveal())
    }
}

/// A text that is no token. It does not repeat the text, which may be nearly one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("this is not a farm's token; 'coordinator token show' prints it, as {PREFIX}.….…")]
pub struct NotAToken;

impl FromStr for Token {
    type Err = NotAToken;

    fn from_str(text: &str) -> Result<Self, NotAToken> {
        let mut parts = text.trim().split('.');
        let (Some(PREFIX), Some(pin), Some(secret), None) = (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return Err(NotAToken);
        };
        let pin = if pin.len() == 43 { URL_SAFE_NO_PAD.decode(pin).ok() } else { None };
        let pin = Pin(pin.and_then(|p| p.try_into().ok()).ok_or(NotAToken)?);
        Ok(Self { pin, secret: Secret::parse(secret).ok_or(NotAToken)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_read_as_it_was_written_and_shown_nowhere_else() {
        let token = Token { pin: Pin::of(b"certificate"), secret: Secret::new().unwrap() };
        let text = token.reveal();
        assert_eq!(format!(" {text}\n").parse(), Ok(token));
        let shown = format!("{token:?}");
        assert!(!shown.contains(&token.secret.reveal()), "{shown}");
        assert_ne!(Secret::new().unwrap(), Secret::new().unwrap());
    }

    #[test]
    fn what_is_no_token_is_said_to_be_none_and_not_repeated() {
        let good = Token { pin: Pin([7; 32]), secret: Secret([9; 16]) }.reveal();
        let cuts = (0..good.len()).map(|n| good[..n].to_owned());
        for bad in cuts.chain([format!("{good}A"), format!("{good}."), good.replace("tessera1", "tessera2")]) {
            let error = bad.parse::<Token>().unwrap_err();
            assert!(!error.to_string().contains("BwcHB"), "{error}");
        }
    }
}
