//! Clients that speak TLS by rustls on ring.

use std::sync::Arc;

use reqwest::ClientBuilder;
use reqwest::redirect::Policy;
use rustls::{ClientConfig, RootCertStore};
use rustls_platform_verifier::BuilderVerifierExt;

/// How a client speaks TLS: it trusts what the system trusts. With `https` false it reads no certificates, and can speak
/// to nobody.
///
/// # Errors
/// A system without certificates, in a sentence.
pub fn tls_config(https: bool) -> Result<ClientConfig, String> {
    let ring = Arc::new(rustls::crypto::ring::default_provider());
    let versions = ClientConfig::builder_with_provider(ring)
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?;
    let trusting = if https {
        versions.with_platform_verifier().map_err(|error| error.to_string())?
    } else {
        versions.with_root_certificates(RootCertStore::empty())
    };
    Ok(trusting.with_no_client_auth())
}

/// An HTTP client that follows no redirects (what is sent to one host is for that host), to be built further. With `https`
/// it trusts what the system trusts; without, it reads no certificates and can only speak plain HTTP. reqwest is built
/// without a TLS provider of its own here, so that its `Client::new` panics: this is the way to a client.
///
/// # Errors
/// A system without certificates, in a sentence.
pub fn http_client(https: bool) -> Result<ClientBuilder, String> {
    let tls = tls_config(https)?;
    Ok(ClientBuilder::new().tls_backend_preconfigured(tls).redirect(Policy::none()))
}
