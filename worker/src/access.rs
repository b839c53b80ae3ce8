//! How a worker knows the coordinator, and is known by it: TLS, and what its token says.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tessera_proto::credential::{self, CredentialError, certificates, private_key};
use tessera_proto::limits::REGISTER_WITHIN;
use tessera_proto::token::{FARM_NAME, Pin, Secret, Token};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::client::WebPkiServerVerifier;
use tokio_rustls::rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use tokio_rustls::rustls::crypto::{CryptoProvider, ring};
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use tokio_rustls::rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, Error as TlsError, RootCertStore, SignatureScheme, version,
};
use tonic::metadata::{Ascii, MetadataValue};

use crate::address::Address;

/// Files of a certificate authority of one's own. All are in PEM form.
#[derive(Clone, Debug, Default)]
pub struct PkiFiles {
    /// Authorities that the coordinator's certificate may come from.
    pub ca: Option<PathBuf>,
    /// This worker's certificate, and the chain behind it.
    pub cert: Option<PathBuf>,
    /// The key of that certificate.
    pub key: Option<PathBuf>,
}

/// Why there is no way in by what was given.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// A token, certificate or key that is not there, or is none.
    #[error(transparent)]
    Credential(#[from] CredentialError),
    /// A certificate without its key, or the other way round.
    #[error("--tls-cert and --tls-key belong together")]
    Half,
    /// They are there, but make no TLS.
    #[error("these certificates cannot be used: {0}")]
    Tls(String),
}

/// How to reach a coordinator.
#[derive(Clone, Default)]
pub struct Access {
    tls: Option<TlsConnector>,
    bearer: Option<Secret>,
}

impl fmt::Debug for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Access").field("tls", &self.tls.is_some()).field("bearer", &self.bearer).finish()
    }
}

impl Access {
    /// Without TLS and without a secret: for coordinators that only this machine can reach.
    #[must_use]
    pub fn open() -> Self {
        Self::default()
    }

    /// By a token.
    ///
    /// # Errors
    /// Never, as far as the token goes.
    pub fn by_token(token: &Token) -> Result<Self, AccessError> {
        Self::new(Some(token), &PkiFiles::default())
    }

    /// By a token, by certificates, or by both; open where there is neither.
    ///
    /// # Errors
    /// When a file cannot be read or holds something else.
    pub fn new(token: Option<&Token>, files: &PkiFiles) -> Result<Self, AccessError> {
        if token.is_none() && files.ca.is_none() && files.cert.is_none() && files.key.is_none() {
            return Ok(Self::open());
        }
        let wrong = |e: &dyn fmt::Display| AccessError::Tls(e.to_string());
        let provider = Arc::new(ring::default_provider());
        let builder = ClientConfig::builder_with_provider(provider.clone())
            .with_protocol_versions(&[&version::TLS13])
            .map_err(|e| wrong(&e))?;
        let builder = match (token, &files.ca) {
            (Some(token), _) => builder
                .dangerous()
                .with_custom_certificate_verifier(Arc::new(Pinned { pin: token.pin, provider: provider.clone() })),
            (None, Some(ca)) => builder.with_root_certificates(roots(ca)?),
            (None, None) => {
                return Err(AccessError::Tls("a certificate needs --tls-ca or a token beside it".into()));
            }
        };
        let mut config = match (&files.cert, &files.key) {
            (None, None) => builder.with_no_client_auth(),
            (Some(cert), Some(key)) => {
                builder.with_client_auth_cert(certificates(cert)?, private_key(key)?).map_err(|e| wrong(&e))?
            }
            _ => return Err(AccessError::Half),
        };
        config.alpn_protocols = vec![b"h2".to_vec()];
        let tls = Some(TlsConnector::from(Arc::new(config)));
        Ok(Self { tls, bearer: token.map(|t| t.secret) })
    }

    /// What goes into the metadata of every call.
    pub(crate) fn authorization(&self) -> Option<MetadataValue<Ascii>> {
        let mut value: MetadataValue<Ascii> = format!("Bearer {}", self.bearer?.reveal()).parse().ok()?;
        // Neither logged nor kept in tables of headers that were sent.
        value.set_sensitive(true);
        Some(value)
    }

    /// Connects, and makes sure that whoever answers is the coordinator before anything is said to it.
    pub(crate) async fn connect(&self, to: &Address) -> std::io::Result<Wire> {
        let tcp = TcpStream::connect(to.to_string()).await?;
        // Small messages must not wait for large ones.
        tcp.set_nodelay(true)?;
        let Some(tls) = &self.tls else { return Ok(Box::new(tcp)) };
        let name = ServerName::try_from(to.host().to_owned()).map_err(std::io::Error::other)?;
        let stream = tokio::time::timeout(REGISTER_WITHIN, tls.connect(name, tcp))
            .await
            .map_err(|_| std::io::Error::other("whoever listens there does not speak TLS"))?
            .map_err(|e| explain(&e))?;
        Ok(Box::new(stream))
    }
}

/// What a failed handshake means to whoever started the worker.
fn explain(e: &std::io::Error) -> std::io::Error {
    let tls = e.get_ref().and_then(|e| e.downcast_ref::<TlsError>());
    std::io::Error::other(match tls {
        Some(TlsError::InvalidCertificate(CertificateError::UnknownIssuer)) => {
            "whoever listens there is not the coordinator of this farm: its certificate is another's".to_owned()
        }
        Some(TlsError::InvalidMessage(_)) => {
            "whoever listens there does not speak TLS; a coordinator with --insecure wants no token".to_owned()
        }
        _ => format!("no TLS: {e}"),
    })
}

/// Bytes to and from a coordinator.
pub(crate) trait Stream: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Stream for T {}

/// A connection, with TLS or without.
pub(crate) type Wire = Box<dyn Stream>;

fn roots(path: &Path) -> Result<RootCertStore, AccessError> {
    let mut roots = RootCertStore::empty();
    for certificate in certificates(path)? {
        let why = |e: TlsError| CredentialError::Content { path: path.into(), what: "authority", why: e.to_string() };
        roots.add(certificate).map_err(why)?;
    }
    Ok(roots)
}

/// Takes the certificate that a token names, or one that the named one has signed.
#[derive(Debug)]
struct Pinned {
    pin: Pin,
    provider: Arc<CryptoProvider>,
}

impl ServerCertVerifier for Pinned {
    fn verify_server_cert(
        &self,
        leaf: &CertificateDer<'_>,
        chain: &[CertificateDer<'_>],
        host: &ServerName<'_>,
        ocsp: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, TlsError> {
        if Pin::of(leaf) == self.pin {
            return Ok(ServerCertVerified::assertion());
        }
        let named = chain.iter().find(|c| Pin::of(c) == self.pin);
        let named = named.ok_or(TlsError::InvalidCertificate(CertificateError::UnknownIssuer))?;
        let mut roots = RootCertStore::empty();
        roots.add(named.clone().into_owned())?;
        let verifier = WebPkiServerVerifier::builder_with_provider(Arc::new(roots), self.provider.clone())
            .build()
            .map_err(|e| TlsError::General(e.to_string()))?;
        // A farm's own authority signs for that farm alone; another's signs for hosts.
        let farm = ServerName::try_from(FARM_NAME).map_err(|e| TlsError::General(e.to_string()))?;
        let by_farm = verifier.verify_server_cert(leaf, chain, &farm, ocsp, now);
        by_farm.or_else(|_| verifier.verify_server_cert(leaf, chain, host, ocsp, now))
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, TlsError> {
        Err(TlsError::General("TLS 1.2 is not spoken".into()))
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, TlsError> {
        let algorithms = &self.provider.signature_verification_algorithms;
        tokio_rustls::rustls::crypto::verify_tls13_signature(message, cert, dss, algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.provider.signature_verification_algorithms.supported_schemes()
    }
}

/// The token that was given: on the command line, in a file, or in the environment, in this order.
///
/// # Errors
/// When the file cannot be read, or what was given is no token.
pub fn given_token(
    text: Option<&str>,
    file: Option<&Path>,
    environment: Option<&str>,
) -> Result<Option<Token>, AccessError> {
    let found = match (text, file, environment) {
        (Some(text), ..) => credential::token(text, "--token")?,
        (None, Some(path), _) => {
            let text = std::fs::read_to_string(path).map_err(CredentialError::file(path))?;
            credential::token(&text, format!("'{}'", path.display()))?
        }
        (None, None, Some(text)) if !text.is_empty() => credential::token(text, "TESSERA_TOKEN")?,
        _ => return Ok(None),
    };
    Ok(Some(found))
}
