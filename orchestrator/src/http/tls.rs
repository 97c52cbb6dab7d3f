//! TLS of the server: its certificate and key come from files, which the server can read again while it runs.
//!
//! [`ServerTls`] holds the settings, [`TlsHandshakes`] completes the handshakes of connections within their limits.

use std::fmt::Display;
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parking_lot::RwLock;
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;

use super::counted_stream::CountedStream;
use crate::limits::Quota;
use crate::limits::constants::{HANDSHAKE_TIMEOUT, MAX_HANDSHAKES, MAX_HANDSHAKES_PER_ADDRESS};

/// Protocol of all connections. HTTP/2 is not offered: see [`serve`](super::serve).
const PROTOCOL: &[u8] = b"http/1.1";

/// PEM files of the server's certificate.
#[derive(Debug, Clone)]
pub struct TlsFiles {
    /// Certificate of the server, followed by the intermediate certificates.
    pub certificates: PathBuf,
    /// Private key of the certificate.
    pub key: PathBuf,
}

/// Reason why the files cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file cannot be read, or does not have the expected content.
    #[error("{content}: the file {} cannot be used: {reason}; it must be in PEM format", path.display())]
    File {
        /// Flag that names the file.
        content: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Reason of the operating system or the parser.
        reason: String,
    },
    /// The certificate and the key do not form a pair.
    #[error("the key {} does not fit the certificate {}: {reason}; use the key that the certificate was issued for", files.key.display(), files.certificates.display())]
    Pair {
        /// The certificate and the key.
        files: TlsFiles,
        /// Reason of the TLS library.
        reason: String,
    },
}

/// TLS settings of a running server.
#[derive(Debug)]
pub struct ServerTls {
    files: TlsFiles,
    config: RwLock<Arc<ServerConfig>>,
}

impl ServerTls {
    /// Reads the files.
    ///
    /// # Errors
    /// Returns [`TlsError`] if a file cannot be used, or the files are not a pair.
    pub fn load(files: TlsFiles) -> Result<Self, TlsError> {
        let config = RwLock::new(read_config(&files)?);
        Ok(Self { files, config })
    }

    /// Reads the files again. New connections use them; open connections keep their certificate.
    ///
    /// # Errors
    /// Returns the errors of [`ServerTls::load`]. The server then keeps the certificate that it has.
    pub fn reload(&self) -> Result<(), TlsError> {
        *self.config.write() = read_config(&self.files)?;
        Ok(())
    }
}

/// Reads the files of a server, and checks that they are a pair.
fn read_config(files: &TlsFiles) -> Result<Arc<ServerConfig>, TlsError> {
    let certificates = CertificateDer::pem_file_iter(&files.certificates)
        .and_then(Iterator::collect::<Result<Vec<_>, _>>)
        .map_err(|error| file_error("--tls-cert", &files.certificates, &error))?;
    if certificates.is_empty() {
        return Err(file_error("--tls-cert", &files.certificates, &"it has no certificate"));
    }
    let key = PrivateKeyDer::from_pem_file(&files.key)
        .map_err(|error| file_error("--tls-key", &files.key, &error))?;
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(certificates, key));
    let mut config =
        config.map_err(|error| TlsError::Pair { files: files.clone(), reason: error.to_string() })?;
    config.alpn_protocols = vec![PROTOCOL.to_vec()];
    Ok(Arc::new(config))
}

fn file_error(content: &'static str, path: &Path, reason: &impl Display) -> TlsError {
    TlsError::File { content, path: path.to_owned(), reason: reason.to_string() }
}

/// Completes the TLS handshakes of a server, and limits how many are open.
#[derive(Debug)]
pub(super) struct TlsHandshakes {
    tls: Arc<ServerTls>,
    open: Quota<IpAddr>,
}

impl TlsHandshakes {
    pub(super) fn new(tls: Arc<ServerTls>) -> Self {
        Self { tls, open: Quota::new(MAX_HANDSHAKES, MAX_HANDSHAKES_PER_ADDRESS) }
    }

    /// Completes the handshake of a connection.
    ///
    /// # Errors
    /// Returns the reason why the connection must be closed: the handshake fails, takes too long, or too many are open.
    pub(super) async fn complete(
        &self,
        stream: CountedStream,
        peer: IpAddr,
    ) -> anyhow::Result<TlsStream<CountedStream>> {
        let _permit =
            self.open.acquire(Some(&peer)).map_err(|_| anyhow::anyhow!("too many handshakes are open"))?;
        let acceptor = TlsAcceptor::from(Arc::clone(&self.tls.config.read()));
        Ok(tokio::time::timeout(HANDSHAKE_TIMEOUT, acceptor.accept(stream)).await??)
    }
}
