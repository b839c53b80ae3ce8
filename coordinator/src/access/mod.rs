//! Who may join a farm: TLS and tokens, made on first use, or certificates of one's own.
//!
//! A user has one authority, under the user's state folder, and one token, so that workers started with it fit
//! every render of that user. Each coordinator has a certificate of its own from that authority, which lives as
//! long as the process and is written nowhere.

mod state;
mod token_file;

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use rcgen::{BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair};
use tessera_proto::credential::{self, CredentialError, certificates, private_key};
use tessera_proto::token::{FARM_NAME, NoRandomness, Pin, Secret, Token};
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer};
use tokio_rustls::rustls::server::{NoClientAuth, WebPkiClientVerifier, danger::ClientCertVerifier};
use tokio_rustls::rustls::{RootCertStore, ServerConfig, version};

pub use state::State;
use token_file::TokenFile;

/// What is spoken behind TLS, as its handshake calls it.
const GRPC: &[u8] = b"h2";
const HTTP: &[u8] = b"http/1.1";

/// Why a farm cannot be guarded as asked.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// There is nowhere to keep the authority.
    #[error("neither XDG_STATE_HOME nor HOME is set, so there is no place for the farm's certificate and token")]
    NoHome,
    /// A token, certificate or key that is not there, or is none.
    #[error(transparent)]
    Credential(#[from] CredentialError),
    /// Others than its owner may read a secret.
    #[error("'{0}' may be read by others than its owner, who could join then; first: chmod 600 '{0}'", .path.display())]
    Exposed {
        /// Which.
        path: PathBuf,
    },
    /// A token of another farm.
    #[error(
        "{from} is the token of another farm, or of another user: it names another certificate than this \
         coordinator's; 'coordinator token show' prints this one's"
    )]
    OtherFarm {
        /// Where it was given.
        from: String,
    },
    /// Certificates that make no TLS.
    #[error("no TLS by these certificates: {0}")]
    Tls(String),
    /// No secret can be drawn.
    #[error(transparent)]
    Randomness(#[from] NoRandomness),
}

/// Certificates of an authority of one's own, in PEM form.
#[derive(Clone, Debug)]
pub struct Pki {
    /// The coordinator's certificate, and the chain behind it. The token names the last one.
    pub cert: PathBuf,
    /// The key of the certificate.
    pub key: PathBuf,
    /// Authorities whose certificates workers must have; they need no token then.
    pub client_ca: Option<PathBuf>,
}

/// Where a coordinator's token comes from.
#[derive(Clone, Debug)]
pub enum TokenFrom {
    /// This file; it is made on first use.
    File(PathBuf),
    /// This text, for instance of an environment variable called so.
    Text {
        /// The token.
        text: String,
        /// What to call it.
        from: String,
    },
}

/// Who is let in.
#[derive(Clone, Default)]
pub struct Access {
    guard: Option<Arc<Guarded>>,
}

/// A farm that asks.
pub(crate) struct Guarded {
    pub(crate) tls: Arc<ServerConfig>,
    certifier: Certifier,
    /// What workers of this process know the coordinator by.
    pub(crate) pin: Pin,
    /// `None` where certificates are asked for instead.
    token: Option<TokenSource>,
    /// What lets users of a farm that stays in; `None` where there are none.
    user: Option<TokenFile>,
}

/// Where the page's certificate comes from.
enum Certifier {
    Authority(Box<Authority>),
    Pki(Vec<CertificateDer<'static>>, PrivateKeyDer<'static>),
}

enum TokenSource {
    File(TokenFile),
    Fixed(Secret),
}

impl fmt::Debug for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Access").field("guarded", &self.guard.is_some()).finish()
    }
}

impl fmt::Debug for Guarded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Guarded").field("pin", &self.pin).finish_non_exhaustive()
    }
}

impl Access {
    /// Everybody who can reach the farm: for listeners on loopback.
    #[must_use]
    pub fn open() -> Self {
        Self::default()
    }

    /// Whoever has the user's token, or that of `token`. Authority and token are made on first use.
    ///
    /// # Errors
    /// When files cannot be read or written, or the token is of another farm.
    pub fn guarded(state: &State, token: Option<TokenFrom>) -> Result<Self, AccessError> {
        let authority = state.authority()?;
        let (chain, key) = authority.certify(vec![FARM_NAME.into()])?;
        let token = token.unwrap_or_else(|| TokenFrom::File(state.token_path()));
        let pin = authority.pin();
        let token = Some(TokenSource::open(token, pin)?);
        let tls = server_config(chain, key, Arc::new(NoClientAuth), GRPC)?;
        let certifier = Certifier::Authority(Box::new(authority));
        Ok(Self { guard: Some(Arc::new(Guarded { tls, certifier, pin, token, user: None })) })
    }

    /// By certificates of one's own: with authorities for workers these need a certificate, else the token.
    ///
    /// # Errors
    /// When files cannot be read or written or hold something else, or the token names another certificate.
    pub fn by_pki(files: &Pki, state: Option<&State>, token: Option<TokenFrom>) -> Result<Self, AccessError> {
        let chain = certificates(&files.cert)?;
        let key = private_key(&files.key)?;
        let pin = chain.last().map(|c| Pin::of(c)).ok_or_else(|| AccessError::Tls("there is none".into()))?;
        let certifier = Certifier::Pki(chain.clone(), key.clone_key());
        let Some(authorities) = &files.client_ca else {
            let place = || state.map(|s| TokenFrom::File(s.token_path_for(pin))).ok_or(AccessError::NoHome);
            let token = Some(TokenSource::open(token.map_or_else(place, Ok)?, pin)?);
            let tls = server_config(chain, key, Arc::new(NoClientAuth), GRPC)?;
            return Ok(Self { guard: Some(Arc::new(Guarded { tls, certifier, pin, token, user: None })) });
        };
        let mut roots = RootCertStore::empty();
        for certificate in certificates(authorities)? {
            let why = |e: &dyn fmt::Display| AccessError::Tls(format!("'{}': {e}", authorities.display()));
            roots.add(certificate).map_err(|e| why(&e))?;
        }
        // Those without a certificate get an answer in gRPC's terms, and no further.
        let provider = Arc::new(ring::default_provider());
        let verifier = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider)
            .allow_unauthenticated()
            .build()
            .map_err(|e| AccessError::Tls(e.to_string()))?;
        let tls = server_config(chain, key, verifier, GRPC)?;
        Ok(Self { guard: Some(Arc::new(Guarded { tls, certifier, pin, token: None, user: None })) })
    }

    /// The token that lets workers in, where there is one.
    #[must_use]
    pub fn token(&self) -> Option<Token> {
        let guard = self.guard.as_ref()?;
        Some(Token { pin: guard.pin, secret: guard.token.as_ref()?.secret() })
    }

    /// Also lets users in who have the users' token in this file, which is made on first use. Where nothing is asked
    /// for, nothing is asked of users either.
    ///
    /// # Errors
    /// When it cannot be read or written, or is of another farm.
    pub fn with_users(self, path: PathBuf) -> Result<Self, AccessError> {
        let Some(guard) = self.guard else { return Ok(self) };
        let user = Some(TokenFile::open(path, guard.pin)?);
        let guard = Arc::try_unwrap(guard).map_err(|_| AccessError::Tls("it is in use already".into()))?;
        Ok(Self { guard: Some(Arc::new(Guarded { user, ..guard })) })
    }

    /// The users' token, where there is one.
    #[must_use]
    pub fn user_token(&self) -> Option<Token> {
        let guard = self.guard.as_ref()?;
        Some(Token { pin: guard.pin, secret: guard.user.as_ref()?.secret() })
    }

    /// TLS for the page where browsers call this machine by `names`, and the pin of the certificate that they see:
    /// one's own, or one of the user's authority. Browsers are asked for no certificate; they log in.
    ///
    /// # Errors
    /// [`AccessError::Tls`] where nothing is asked for, or a name cannot stand in a certificate.
    pub(crate) fn page_tls(&self, names: Vec<String>) -> Result<(Arc<ServerConfig>, Pin), AccessError> {
        let guard = self.guard.as_ref().ok_or_else(|| AccessError::Tls("the farm has none".into()))?;
        let (chain, key) = match &guard.certifier {
            Certifier::Authority(authority) => authority.certify(names)?,
            Certifier::Pki(chain, key) => (chain.clone(), key.clone_key()),
        };
        let pin = chain.first().map(|c| Pin::of(c)).ok_or_else(|| AccessError::Tls("there is none".into()))?;
        Ok((server_config(chain, key, Arc::new(NoClientAuth), HTTP)?, pin))
    }

    /// Whether anything is asked for.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.guard.is_none()
    }

    pub(crate) fn guard(&self) -> Option<&Arc<Guarded>> {
        self.guard.as_ref()
    }
}

impl Guarded {
    /// Whether certificates of workers are asked for rather than a token.
    pub(crate) fn wants_certificates(&self) -> bool {
        self.token.is_none()
    }

    /// Whether this is the farm's secret now.
    pub(crate) fn admits(&self, secret: &Secret) -> bool {
        self.token.as_ref().is_some_and(|t| t.secret() == *secret)
    }
}

impl Guarded {
    /// Whether this is the users' secret now.
    pub(crate) fn admits_user(&self, secret: &Secret) -> bool {
        self.user.as_ref().is_some_and(|t| t.secret() == *secret)
    }
}

impl TokenSource {
    fn open(from: TokenFrom, pin: Pin) -> Result<Self, AccessError> {
        match from {
            TokenFrom::File(path) => Ok(Self::File(TokenFile::open(path, pin)?)),
            TokenFrom::Text { text, from } => {
                let token = credential::token(&text, &from)?;
                if token.pin == pin { Ok(Self::Fixed(token.secret)) } else { Err(AccessError::OtherFarm { from }) }
            }
        }
    }

    fn secret(&self) -> Secret {
        match self {
            Self::File(file) => file.secret(),
            Self::Fixed(secret) => *secret,
        }
    }
}

/// An authority, as its file's text, and tokens of a farm that nobody has yet.
pub(crate) struct FreshSecrets {
    pub(crate) authority: String,
    pub(crate) token: String,
    pub(crate) user_token: String,
}

/// Makes them, and keeps them nowhere.
///
/// # Errors
/// When the system gives no random numbers.
pub(crate) fn fresh_secrets() -> Result<FreshSecrets, AccessError> {
    let authority = Authority::make().map_err(|e| AccessError::Tls(e.to_string()))?;
    let pin = Authority::read(&authority).map_err(AccessError::Tls)?.pin();
    let token = || Ok::<_, AccessError>(Token { pin, secret: Secret::new()? }.reveal());
    Ok(FreshSecrets { token: token()?, user_token: token()?, authority })
}

fn server_config(
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
    clients: Arc<dyn ClientCertVerifier>,
    protocol: &[u8],
) -> Result<Arc<ServerConfig>, AccessError> {
    let wrong = |e: &dyn fmt::Display| AccessError::Tls(e.to_string());
    let mut config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(&[&version::TLS13])
        .map_err(|e| wrong(&e))?
        .with_client_cert_verifier(clients)
        .with_single_cert(chain, key)
        .map_err(|e| wrong(&e))?;
    config.alpn_protocols = vec![protocol.to_vec()];
    Ok(Arc::new(config))
}

/// What signs the certificates of a user's coordinators.
pub(crate) struct Authority {
    certificate: CertificateDer<'static>,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    /// What authorities of this kind have in common: with it and its key, one is whole again.
    fn params() -> Result<CertificateParams, rcgen::Error> {
        let mut params = CertificateParams::new(Vec::new())?;
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.distinguished_name.push(DnType::CommonName, "Tessera farm");
        Ok(params)
    }

    /// A new one, as a PEM file's text.
    fn make() -> Result<String, rcgen::Error> {
        let key = KeyPair::generate()?;
        let certificate = Self::params()?.self_signed(&key)?;
        Ok(certificate.pem() + &key.serialize_pem())
    }

    /// What [`Authority::make`] made.
    fn read(text: &str) -> Result<Self, String> {
        let certificate = CertificateDer::from_pem_slice(text.as_bytes()).map_err(|e| e.to_string())?;
        let key = PrivatePkcs8KeyDer::from_pem_slice(text.as_bytes()).map_err(|e| e.to_string())?;
        let key = KeyPair::try_from(key.secret_pkcs8_der()).map_err(|e| e.to_string())?;
        let issuer = Issuer::new(Self::params().map_err(|e| e.to_string())?, key);
        Ok(Self { certificate, issuer })
    }

    pub(crate) fn pin(&self) -> Pin {
        Pin::of(&self.certificate)
    }

    /// A certificate for a coordinator of these names, with this one behind it, and its key.
    fn certify(
        &self,
        names: Vec<String>,
    ) -> Result<(Vec<CertificateDer<'static>>, PrivateKeyDer<'static>), AccessError> {
        let make = || {
            let key = KeyPair::generate()?;
            let mut params = CertificateParams::new(names)?;
            params.distinguished_name.push(DnType::CommonName, FARM_NAME);
            params.insert_extended_key_usage(ExtendedKeyUsagePurpose::ServerAuth);
            Ok::<_, rcgen::Error>((params.signed_by(&key, &self.issuer)?, key))
        };
        let (leaf, key) = make().map_err(|e| AccessError::Tls(e.to_string()))?;
        let chain = vec![leaf.der().clone(), self.certificate.clone()];
        Ok((chain, PrivatePkcs8KeyDer::from(key.serialize_der()).into()))
    }
}
