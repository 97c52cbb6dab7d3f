//! `--nats…`: how servers and workers find each other.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use job_queue::nats::{ClusterName, NatsConfig, NatsUrl};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;

/// Arguments of a connection to NATS that must be made.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "NATS")]
pub struct NatsArgs {
    /// URL of a NATS server with JetStream, such as nats://10.0.0.5:4222 or tls://nats.example.com; several with commas between
    /// them
    #[arg(long, value_name = "URL", env = "SPARRING_NATS", hide_env_values = true)]
    nats: String,
    #[command(flatten)]
    account: NatsAccountArgs,
}

/// Account and name of a connection to NATS.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "NATS")]
pub struct NatsAccountArgs {
    /// File with the credentials of a NATS account (.creds) or the seed of an nkey (SU…), if the NATS server requires one
    #[arg(long, value_name = "FILE", env = "SPARRING_NATS_CREDS", hide_env_values = true)]
    nats_creds: Option<PathBuf>,
    /// File with the certificate authorities of the NATS server, in PEM; the connection is then always encrypted (default: the
    /// authorities of the system, for tls:// and servers that require TLS)
    #[arg(long, value_name = "FILE", env = "SPARRING_NATS_CA", hide_env_values = true)]
    nats_ca: Option<PathBuf>,
    /// Name under which servers and workers find each other: letters, digits, `-` and `_`
    #[arg(
        long,
        value_name = "NAME",
        env = "SPARRING_NATS_NAME",
        hide_env_values = true,
        default_value = "default"
    )]
    nats_name: ClusterName,
}

impl NatsArgs {
    /// Returns the configuration of the connection.
    ///
    /// # Errors
    /// Returns an error if the file of an option cannot be used.
    pub fn config(&self) -> anyhow::Result<NatsConfig> {
        self.account.config(&self.nats)
    }
}

impl NatsAccountArgs {
    /// Returns the first option that differs from its default, or `None`.
    #[must_use]
    pub fn first_option(&self) -> Option<&'static str> {
        let options = [
            ("--nats-creds", self.nats_creds.is_some()),
            ("--nats-ca", self.nats_ca.is_some()),
            ("--nats-name", self.nats_name != ClusterName::default()),
        ];
        options.into_iter().find(|(_, is_set)| *is_set).map(|(option, _)| option)
    }

    /// Returns the configuration of a connection to a URL. Errors do not repeat the URL, which may have a password.
    ///
    /// # Errors
    /// Returns an error if the URL is invalid, or if the file of an option cannot be used.
    pub fn config(&self, url: &str) -> anyhow::Result<NatsConfig> {
        let url: NatsUrl = url.parse().context("--nats")?;
        let config = NatsConfig {
            url,
            credentials: self.nats_creds.clone(),
            authorities: self.nats_ca.clone(),
            cluster: self.nats_name.clone(),
        };
        config.check_credentials()?;
        if let Some(file) = &self.nats_ca {
            check_authorities(file).with_context(|| format!("--nats-ca {}", file.display()))?;
        }
        Ok(config)
    }
}

/// Checks that a file has certificates.
fn check_authorities(file: &Path) -> anyhow::Result<()> {
    let text = std::fs::read(file)?;
    let certificates = CertificateDer::pem_slice_iter(&text).collect::<Result<Vec<_>, _>>()?;
    if certificates.is_empty() {
        bail!("the file has no certificate in PEM (-----BEGIN CERTIFICATE-----)");
    }
    Ok(())
}
