//! Certificate authority of a test, and the certificate and key of a server under it.

use std::path::PathBuf;
use std::sync::Arc;

use llm::{TrustedRoots, http_client_builder, tls_config};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};
use tokio_tungstenite::Connector;

use crate::ApiClient;

/// Temporary folder with the files `ca.pem`, `cert.pem` and `key.pem`.
#[derive(Debug)]
pub struct TlsFiles {
    folder: tempfile::TempDir,
    issuer: CertifiedIssuer<'static, KeyPair>,
}

impl TlsFiles {
    /// Creates an authority and issues the first certificate.
    ///
    /// # Panics
    /// Panics if the folder cannot be written.
    #[must_use]
    pub fn create() -> Self {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().expect("a key");
        let issuer = CertifiedIssuer::self_signed(params, key).expect("the authority signs itself");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let files = Self { folder, issuer };
        std::fs::write(files.path("ca.pem"), files.issuer.pem()).expect("the folder is writable");
        files.issue();
        files
    }

    /// Issues a new certificate with a new key, for `localhost` and 127.0.0.1.
    ///
    /// # Panics
    /// Panics if the folder cannot be written.
    pub fn issue(&self) {
        let key = KeyPair::generate().expect("a key");
        let names = ["localhost", "127.0.0.1"].map(str::to_owned);
        let params = CertificateParams::new(names).expect("valid names");
        let certificate = params.signed_by(&key, &self.issuer).expect("the authority signs");
        std::fs::write(self.path("cert.pem"), certificate.pem()).expect("the folder is writable");
        std::fs::write(self.path("key.pem"), key.serialize_pem()).expect("the folder is writable");
    }

    /// Path of a file in the folder.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Options of `sparring serve` that use the certificate.
    ///
    /// # Panics
    /// Panics if the path of the folder is not UTF-8.
    #[must_use]
    pub fn serve_options(&self) -> [String; 4] {
        let path = |name| self.path(name).to_str().expect("a temporary path is UTF-8").to_owned();
        ["--tls-cert".to_owned(), path("cert.pem"), "--tls-key".to_owned(), path("key.pem")]
    }

    /// HTTP client that trusts the authority only.
    ///
    /// # Panics
    /// Panics if the client cannot be built.
    #[must_use]
    pub fn http_client(&self) -> reqwest::Client {
        let builder = http_client_builder(TrustedRoots::File(&self.path("ca.pem"))).expect("the authority");
        builder.build().expect("a client")
    }

    /// Connector of WebSockets that trusts the authority only.
    ///
    /// # Panics
    /// Panics if the file of the authority cannot be read.
    #[must_use]
    pub fn connector(&self) -> Connector {
        Connector::Rustls(Arc::new(
            tls_config(TrustedRoots::File(&self.path("ca.pem"))).expect("the authority"),
        ))
    }

    /// Client of the server at an `https` URL.
    #[must_use]
    pub fn api(&self, base: &str) -> ApiClient {
        ApiClient::new(base).with_tls(self.http_client(), self.connector())
    }
}
