//! Which worker this is: a key that it draws when it starts, proven anew on every connection.
//!
//! A number that a worker merely states can be stated by others too: whoever saw it could have its owner shut
//! out. A signature over what the coordinator drew for this one connection cannot be repeated elsewhere.

use std::fmt;

use ring::signature::{ED25519, Ed25519KeyPair, KeyPair, UnparsedPublicKey};

use crate::token::{NoRandomness, random};

/// What signatures are made for, so that none can be used for anything else.
const PURPOSE: &[u8] = b"tessera farm: register\0";

/// What a coordinator draws for one connection.
pub type Challenge = [u8; 32];

/// A worker's key pair, as long as its process lives.
pub struct Identity(Ed25519KeyPair);

/// The public half: what a coordinator knows a worker by.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct WorkerId(pub [u8; 32]);

impl Identity {
    /// A new one.
    ///
    /// # Errors
    /// When the system has no randomness.
    pub fn new() -> Result<Self, NoRandomness> {
        Self::from_seed(&random()?)
    }

    /// The same for the same seed, which must be secret.
    ///
    /// # Errors
    /// Never: every seed makes a key.
    pub fn from_seed(seed: &[u8; 32]) -> Result<Self, NoRandomness> {
        Ed25519KeyPair::from_seed_unchecked(seed).map(Self).map_err(|_| NoRandomness)
    }

    /// The public half.
    ///
    /// # Panics
    /// Never: a key of this kind is 32 bytes long.
    #[must_use]
    pub fn id(&self) -> WorkerId {
        let mut id = [0; 32];
        id.copy_from_slice(self.0.public_key().as_ref());
        WorkerId(id)
    }

    /// The answer to `challenge`.
    #[must_use]
    pub fn prove(&self, challenge: &Challenge) -> Vec<u8> {
        self.0.sign(&[PURPOSE, challenge].concat()).as_ref().to_vec()
    }
}

impl WorkerId {
    /// Whether `proof` answers `challenge`, which only the owner of the key can.
    #[must_use]
    pub fn has_proven(&self, challenge: &Challenge, proof: &[u8]) -> bool {
        UnparsedPublicKey::new(&ED25519, self.0).verify(&[PURPOSE, challenge].concat(), proof).is_ok()
    }
}

impl fmt::Debug for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Identity({:?})", self.id())
    }
}

impl fmt::Debug for WorkerId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0[..8].iter().try_for_each(|b| write!(f, "{b:02x}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_owner_answers_and_only_this_challenge() {
        let (one, other) = (Identity::new().unwrap(), Identity::new().unwrap());
        let proof = one.prove(&[1; 32]);
        assert!(one.id().has_proven(&[1; 32], &proof));
        assert!(!one.id().has_proven(&[2; 32], &proof), "a proof of another connection");
        assert!(!other.id().has_proven(&[1; 32], &proof), "a proof by another");
        assert!(!one.id().has_proven(&[1; 32], &[]));
        assert!(!WorkerId([0; 32]).has_proven(&[1; 32], &[0; 64]), "a key that is none");
    }
}
