//! Connections to NATS, for servers and workers.

use std::path::{Path, PathBuf};
use std::time::Duration;

use async_nats::{Client, ConnectError, ConnectErrorKind, ConnectOptions, Event};
use tokio::sync::watch;

use super::names::ClusterName;
use super::url::NatsUrl;

/// Time that connecting may take.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// How to reach NATS.
#[derive(Debug, Clone)]
pub struct NatsConfig {
    /// URL of a NATS server, or of several.
    pub url: NatsUrl,
    /// File with the credentials of a NATS account, or with the seed of an nkey, if the server requires one.
    pub credentials: Option<PathBuf>,
    /// File with the certificate authorities of the server, in PEM, which makes TLS a must; those of the system if there is none.
    pub authorities: Option<PathBuf>,
    /// Name under which servers and workers find each other.
    pub cluster: ClusterName,
}

impl NatsConfig {
    /// Checks the file with the credentials, so that a mistake is found before the first connection.
    ///
    /// # Errors
    /// Returns [`NatsError::Rejected`] if the file cannot be read or has no credentials.
    pub fn check_credentials(&self) -> Result<(), NatsError> {
        let Some(file) = &self.credentials else { return Ok(()) };
        with_credentials(ConnectOptions::new(), file).map(drop)
    }
}

/// Reason why NATS cannot be used.
#[derive(Debug, Clone, thiserror::Error)]
pub enum NatsError {
    /// NATS refuses the credentials, or they cannot be used. Waiting does not help.
    #[error("{0}; check the credentials (--nats-creds)")]
    Rejected(String),
    /// NATS cannot be reached, or a request failed.
    #[error("{0}")]
    Failed(String),
}

impl NatsError {
    /// Describes a failed step.
    pub(crate) fn new(step: &str, error: impl std::fmt::Display) -> Self {
        Self::Failed(format!("{step}: {error}"))
    }

    /// Describes a failed attempt to connect.
    fn connecting(config: &NatsConfig, error: &ConnectError) -> Self {
        match error.kind() {
            ConnectErrorKind::AuthorizationViolation | ConnectErrorKind::Authentication => {
                Self::Rejected(format!("NATS rejects this program: {error}"))
            }
            _ if config.authorities.is_some() => Self::new("NATS cannot be reached by TLS", error),
            _ => Self::new("NATS cannot be reached", error),
        }
    }
}

/// An open connection. It ends with the first interruption; its owner then opens a new one.
pub(crate) struct Connection {
    pub(crate) client: Client,
    /// True after the connection was interrupted.
    interrupted: watch::Receiver<bool>,
}

impl Connection {
    /// Connects. `role` is shown in the lists of the NATS server.
    pub(crate) async fn open(config: &NatsConfig, role: &str) -> Result<Self, NatsError> {
        let (sender, interrupted) = watch::channel(false);
        let options = ConnectOptions::new().name(role).connection_timeout(CONNECT_TIMEOUT).event_callback(
            move |event| {
                let sender = sender.clone();
                async move {
                    if matches!(event, Event::Disconnected | Event::Closed) {
                        sender.send_replace(true);
                    }
                }
            },
        );
        let options = match &config.credentials {
            None => options,
            Some(file) => with_credentials(options, file)?,
        };
        let options = match &config.authorities {
            None => options,
            // Otherwise a server without TLS would read the credentials.
            Some(file) => options.add_root_certificates(file.clone()).require_tls(true),
        };
        let client = options.connect(config.url.servers()).await;
        let client = client.map_err(|error| NatsError::connecting(config, &error))?;
        Ok(Self { client, interrupted })
    }

    /// Waits until the connection is interrupted.
    pub(crate) async fn interrupted(&mut self) {
        // An error means that the client is gone, which is an interruption too.
        let _ = self.interrupted.wait_for(|interrupted| *interrupted).await;
    }

    /// Returns a future that ends when the connection is interrupted, and borrows nothing.
    pub(crate) fn interruption(&self) -> impl Future<Output = ()> + Send + use<> {
        let mut interrupted = self.interrupted.clone();
        async move {
            let _ = interrupted.wait_for(|interrupted| *interrupted).await;
        }
    }
}

/// Adds the credentials of a file: a token with its key, as NATS accounts have them (`.creds`), or the seed of an nkey (`SU…`).
fn with_credentials(options: ConnectOptions, file: &Path) -> Result<ConnectOptions, NatsError> {
    let invalid =
        |error: String| NatsError::Rejected(format!("the file {} cannot be used: {error}", file.display()));
    let text = std::fs::read_to_string(file).map_err(|error| invalid(error.to_string()))?;
    match text.trim() {
        seed if seed.starts_with("SU") => Ok(options.nkey(seed.to_owned())),
        credentials => options.credentials(credentials).map_err(|error| invalid(error.to_string())),
    }
}
