//! TLS configuration: rustls with the ring provider.

use std::path::Path;
use std::sync::Arc;

use reqwest::ClientBuilder;
use reqwest::redirect::Policy;
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use rustls::{ClientConfig, RootCertStore};
use rustls_platform_verifier::BuilderVerifierExt;

/// Certificate authorities that a client trusts.
#[derive(Debug, Clone, Copy)]
pub enum TrustedRoots<'a> {
    /// None: the client can only use plain HTTP.
    None,
    /// Those of the operating system.
    System,
    /// Only those in a PEM file.
    File(&'a Path),
}

/// Returns the TLS configuration of a client.
///
/// # Errors
/// Returns a message if the operating system has no certificates, or the file has none or cannot be read.
pub fn tls_config(roots: TrustedRoots<'_>) -> Result<ClientConfig, String> {
    let ring = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(ring)
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?;
    let with_roots = match roots {
        TrustedRoots::None => builder.with_root_certificates(RootCertStore::empty()),
        TrustedRoots::System => builder.with_platform_verifier().map_err(|error| error.to_string())?,
        TrustedRoots::File(path) => builder.with_root_certificates(read_roots(path)?),
    };
    Ok(with_roots.with_no_client_auth())
}

/// Reads the certificate authorities of a PEM file.
fn read_roots(path: &Path) -> Result<RootCertStore, String> {
    let unusable = |reason: String| format!("the file {} cannot be used: {reason}", path.display());
    let certificates = CertificateDer::pem_file_iter(path).map_err(|error| unusable(error.to_string()))?;
    let mut roots = RootCertStore::empty();
    for certificate in certificates {
        let added = certificate
            .map_err(|error| error.to_string())
            .and_then(|certificate| roots.add(certificate).map_err(|error| error.to_string()));
        added.map_err(unusable)?;
    }
    if roots.is_empty() {
        return Err(unusable("it has no certificate in PEM format".to_owned()));
    }
    Ok(roots)
}

/// Returns the builder of an HTTP client that follows no redirects: a request with a key stays with its host.
///
/// reqwest is built without a TLS provider in this workspace, so that its `Client::new` panics. Use this function instead.
///
/// # Errors
/// Returns the errors of [`tls_config`].
pub fn http_client_builder(roots: TrustedRoots<'_>) -> Result<ClientBuilder, String> {
    let tls = tls_config(roots)?;
    Ok(ClientBuilder::new().tls_backend_preconfigured(tls).redirect(Policy::none()))
}
