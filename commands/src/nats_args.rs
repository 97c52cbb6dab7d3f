//! `--nats…`: how servers and workers find each other.

use std::path::PathBuf;

use job_queue::nats::{ClusterName, NatsConfig};

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
    /// File with the certificate authorities of the NATS server, in PEM (default: those of the system)
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
    #[must_use]
    pub fn config(&self) -> NatsConfig {
        self.account.config(&self.nats)
    }
}

impl NatsAccountArgs {
    /// Returns the configuration of a connection to a URL.
    #[must_use]
    pub fn config(&self, url: &str) -> NatsConfig {
        NatsConfig {
            url: url.to_owned(),
            credentials: self.nats_creds.clone(),
            authorities: self.nats_ca.clone(),
            cluster: self.nats_name.clone(),
        }
    }
}
