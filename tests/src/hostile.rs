//! Peers that speak HTTP/2, and none of the rest: where a gRPC library would be too polite.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use h2::client::SendRequest;
use http::{HeaderMap, Method, Request};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use tokio_rustls::rustls::{ClientConfig, DigitallySignedStruct, Error, SignatureScheme, version};

/// Longer than anything here takes.
const NEVER: Duration = Duration::from_secs(60);

/// A call's beginning: the first of the service's methods.
pub const GREET: &str = "/tessera.farm.v1.Farm/Greet";
/// The session's stream.
pub const WORK: &str = "/tessera.farm.v1.Farm/Work";
/// The heartbeat.
pub const BEAT: &str = "/tessera.farm.v1.Farm/Beat";

/// What came back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// gRPC's status, if there was one.
    pub status: Option<i32>,
    /// What it says, and all else that was said.
    pub said: String,
}

/// A connection.
#[derive(Clone, Debug)]
pub struct Raw(SendRequest<Bytes>);

impl Raw {
    /// Without TLS.
    ///
    /// # Errors
    /// When the other end breaks off.
    pub async fn plain(addr: SocketAddr) -> Result<Self, String> {
        let tcp = TcpStream::connect(addr).await.map_err(|e| e.to_string())?;
        Self::over(tcp).await
    }

    /// With TLS, whoever answers.
    ///
    /// # Errors
    /// When the other end breaks off.
    pub async fn tls(addr: SocketAddr) -> Result<Self, String> {
        let tcp = TcpStream::connect(addr).await.map_err(|e| e.to_string())?;
        let name = ServerName::from(addr.ip());
        Self::over(credulous().connect(name, tcp).await.map_err(|e| e.to_string())?).await
    }

    async fn over(io: impl AsyncRead + AsyncWrite + Unpin + Send + 'static) -> Result<Self, String> {
        let (send, connection) = h2::client::handshake(io).await.map_err(|e| e.to_string())?;
        tokio::spawn(connection);
        Ok(Self(send))
    }

    /// Calls `path` with these `headers` and `body`; without `end`, more seems to follow for ever.
    ///
    /// # Errors
    /// When the connection or the stream breaks instead of an answer.
    ///
    /// # Panics
    /// When there is no answer for a minute.
    pub async fn call(
        &self,
        path: &str,
        headers: &[(&'static str, String)],
        body: &[u8],
        end: bool,
    ) -> Result<Answer, String> {
        let answer = async {
            let mut send = self.0.clone().ready().await.map_err(|e| e.to_string())?;
            let mut request = Request::builder().method(Method::POST).uri(format!("http://farm{path}"));
            request = request.header("content-type", "application/grpc").header("te", "trailers");
            for (name, value) in headers {
                request = request.header(*name, value);
            }
            let request = request.body(()).map_err(|e| e.to_string())?;
            let (response, mut out) = send.send_request(request, false).map_err(|e| e.to_string())?;
            out.send_data(Bytes::copy_from_slice(body), end).map_err(|e| e.to_string())?;
            let response = response.await.map_err(|e| e.to_string())?;
            let mut said = Headers::default();
            said.hear(response.headers());
            let mut data = response.into_body();
            while let Some(piece) = data.data().await {
                said.text += &String::from_utf8_lossy(&piece.map_err(|e| e.to_string())?);
            }
            if let Some(trailers) = data.trailers().await.map_err(|e| e.to_string())? {
                said.hear(&trailers);
            }
            drop(out);
            Ok(Answer { status: said.status, said: said.text })
        };
        tokio::time::timeout(NEVER, answer).await.expect("there is no answer")
    }
}

#[derive(Default)]
struct Headers {
    status: Option<i32>,
    text: String,
}

impl Headers {
    fn hear(&mut self, headers: &HeaderMap) {
        for (name, value) in headers {
            let value = value.to_str().unwrap_or("?");
            if name == "grpc-status" {
                self.status = value.parse().ok();
            } else if name != "date" {
                self.text += &format!("{name}: {value}\n");
            }
        }
    }
}

/// The bearer of `secret`.
#[must_use]
pub fn bearer(secret: &str) -> [(&'static str, String); 1] {
    [("authorization", format!("Bearer {secret}"))]
}

/// TLS that takes any certificate.
///
/// # Panics
/// Never.
#[must_use]
pub fn credulous() -> TlsConnector {
    let mut config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(&[&version::TLS13])
        .expect("TLS 1.3 is there")
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(Credulous))
        .with_no_client_auth();
    config.alpn_protocols = vec![b"h2".to_vec()];
    TlsConnector::from(Arc::new(config))
}

#[derive(Debug)]
struct Credulous;

impl ServerCertVerifier for Credulous {
    fn verify_server_cert(
        &self,
        _: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn verify_tls13_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        ring::default_provider().signature_verification_algorithms.supported_schemes()
    }
}
