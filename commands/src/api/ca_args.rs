//! `--ca`: the certificate authorities of a server with TLS.

use std::path::PathBuf;

use llm::TrustedRoots;

/// Arguments of a TLS connection to a server.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct CaArgs {
    /// PEM file with the certificate authorities to trust for an https server [default: those of the operating system]
    #[arg(long, global = true, value_name = "FILE", env = "SPARRING_CA_FILE", help_heading = "Server")]
    ca: Option<PathBuf>,
}

impl CaArgs {
    /// Returns the certificate authorities for a server with or without TLS.
    pub(crate) fn roots(&self, https: bool) -> TrustedRoots<'_> {
        match &self.ca {
            _ if !https => TrustedRoots::None,
            Some(file) => TrustedRoots::File(file),
            None => TrustedRoots::System,
        }
    }
}
