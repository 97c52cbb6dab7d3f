//! TLS configuration: rustls with the ring provider.

use std::sync::Arc;

use reqwest::ClientBuilder;
use reqwest::redirect::Policy;
use rustls::{ClientConfig, RootCertStore};
use rustls_platform_verifier::BuilderVerifierExt;

/// Returns the TLS configuration of a client. If `https` is true, it trusts the certificates of the operating system;
/// otherwise it reads no certificates and trusts no server.
///
/// # Errors
/// Returns a message if the operating system has no certificates.
pub fn tls_config(https: bool) -> Result<ClientConfig, String> {
    let ring = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(ring)
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?;
    let with_roots = if https {
        builder.with_platform_verifier().map_err(|error| error.to_string())?
    } else {
        builder.with_root_certificates(RootCertStore::empty())
    };
    Ok(with_roots.with_no_client_auth())
}

/// Returns the builder of an HTTP client that follows no redirects: a request with a key stays with its host. If `https` is
/// true, the client trusts the certificates of the operating system; otherwise it reads none and can only use plain HTTP.
///
/// reqwest is built without a TLS provider in this workspace, so that its `Client::new` panics. Use this function instead.
///
/// # Errors
/// Returns a message if the operating system has no certificates.
pub fn http_client_builder(https: bool) -> Result<ClientBuilder, String> {
    let tls = tls_config(https)?;
    Ok(ClientBuilder::new().tls_backend_preconfigured(tls).redirect(Policy::none()))
}
