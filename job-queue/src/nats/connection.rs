//! Connections to NATS, for servers and workers.

use std::path::{Path, PathBuf};
use std::time::Duration;

use async_nats::{Client, ConnectError, ConnectErrorKind, ConnectOptions, Event, ServerError};
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
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NatsError {
    /// NATS refuses the user, or the credentials cannot be used. Waiting does not help.
    #[error("{0}; check the user and password in --nats, or the file of --nats-creds")]
    Rejected(String),
    /// The user may not do what a server or a worker does. Waiting does not help.
    #[error(
        "NATS does not permit this user what it needs ({0}); deploy/nats.conf has the permissions of each role"
    )]
    Denied(String),
    /// Both sides do not agree on TLS. Waiting does not help.
    #[error("{0}")]
    Tls(String),
    /// NATS cannot be reached, or a request failed.
    #[error("{0}")]
    Failed(String),
}

impl NatsError {
    /// Describes a failed step.
    pub(crate) fn new(step: &str, error: impl std::fmt::Display) -> Self {
        let text = error.to_string();
        Self::Failed(format!("{step}: {}", without_repetition(&text)))
    }

    /// Describes a failed attempt to connect.
    fn connecting(error: &ConnectError) -> Self {
        let text = error.to_string();
        // The time of each attempt would make it another reason.
        let text = text.split(": verification time").next().unwrap_or_default();
        match error.kind() {
            ConnectErrorKind::AuthorizationViolation | ConnectErrorKind::Authentication => {
                Self::Rejected("NATS rejects this user".to_owned())
            }
            _ if text.contains("InvalidContentType") => {
                let reason = "the NATS server has no TLS, which --nats-ca and tls:// require";
                Self::Tls(reason.to_owned())
            }
            _ if text.contains("invalid peer certificate") => Self::Tls(format!(
                "the certificate of NATS is not valid here ({text}); set --nats-ca to the authority that issued it, and name its host in --nats"
            )),
            _ => Self::new("NATS cannot be reached", text),
        }
    }

    /// True if the connection may open later by itself.
    #[must_use]
    pub const fn passes(&self) -> bool {
        matches!(self, Self::Failed(_))
    }
}

/// Removes the repetition of an error that the client appends to itself, as in "no space: no space".
fn without_repetition(text: &str) -> &str {
    let halves = text.match_indices(": ").map(|(at, separator)| (&text[..at], &text[at + separator.len()..]));
    halves.into_iter().find(|(first, second)| first == second).map_or(text, |(first, _)| first)
}

/// State of a connection.
#[derive(Debug, Clone, PartialEq, Eq)]
enum ConnectionEnd {
    /// The connection is open.
    Open,
    /// The connection was interrupted.
    Interrupted,
    /// NATS denied something that the owner needs, in its own words.
    Denied(String),
}

/// An open connection. It ends with the first interruption; its owner then opens a new one.
pub(crate) struct Connection {
    pub(crate) client: Client,
    end: watch::Receiver<ConnectionEnd>,
}

impl Connection {
    /// Connects. `role` is shown in the lists of the NATS server.
    pub(crate) async fn open(config: &NatsConfig, role: &str) -> Result<Self, NatsError> {
        let (sender, end) = watch::channel(ConnectionEnd::Open);
        let cluster = config.cluster.clone();
        let options = ConnectOptions::new().name(role).connection_timeout(CONNECT_TIMEOUT).event_callback(
            move |event| {
                let ended = end_after(&event, &cluster);
                let sender = sender.clone();
                async move {
                    if let Some(ended) = ended {
                        sender.send_replace(ended);
                    }
                }
            },
        );
        let options = match &config.credentials {
            None => config.url.with_user(options),
            Some(file) => with_credentials(options, file)?,
        };
        let options = match &config.authorities {
            None => options,
            Some(file) => options.add_root_certificates(file.clone()),
        };
        // Otherwise a server without TLS would read the credentials.
        let options = options.require_tls(config.authorities.is_some() || config.url.has_tls());
        let client = options.connect(config.url.servers()).await;
        let client = client.map_err(|error| NatsError::connecting(&error))?;
        Ok(Self { client, end })
    }

    /// Returns a future that ends with the connection, with the reason. It borrows nothing.
    pub(crate) fn end(&self) -> impl Future<Output = NatsError> + Send + use<> {
        let mut end = self.end.clone();
        async move {
            // An error means that the client is gone, which is an interruption too.
            let ended = end.wait_for(|end| *end != ConnectionEnd::Open).await.map(|end| end.clone());
            match ended {
                Ok(ConnectionEnd::Denied(denied)) => NatsError::Denied(denied),
                _ => NatsError::Failed("the connection was interrupted".to_owned()),
            }
        }
    }
}

/// Returns how a connection ends with an event, if it does.
fn end_after(event: &Event, cluster: &ClusterName) -> Option<ConnectionEnd> {
    match event {
        Event::Disconnected | Event::Closed => Some(ConnectionEnd::Interrupted),
        Event::ServerError(ServerError::Other(text)) if is_denial(text, cluster) => {
            Some(ConnectionEnd::Denied(text.clone()))
        }
        _ => None,
    }
}

/// True if NATS denied a subject or a stream of the cluster. The first large message creates its bucket, if its sender may.
fn is_denial(text: &str, cluster: &ClusterName) -> bool {
    let is_needed = text.contains(&format!("sparring.{cluster}."))
        || text.contains(&format!("SPARRING_{cluster}_")) && !text.contains("OBJ_");
    text.to_lowercase().starts_with("permissions violation") && is_needed
}

/// Adds the credentials of a file: a token with its key, as NATS accounts have them (`.creds`), or the seed of an nkey (`SU…`).
fn with_credentials(options: ConnectOptions, file: &Path) -> Result<ConnectOptions, NatsError> {
    let invalid =
        |error: String| NatsError::Rejected(format!("the file {} cannot be used: {error}", file.display()));
    let text = std::fs::read_to_string(file).map_err(|error| invalid(error.to_string()))?;
    match text.trim() {
        seed if seed.starts_with("SU") => {
            nkeys::KeyPair::from_seed(seed)
                .map_err(|error| invalid(format!("the seed of the nkey: {error}")))?;
            Ok(options.nkey(seed.to_owned()))
        }
        credentials => options.credentials(credentials).map_err(|error| invalid(error.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_errors_are_shown_once() {
        for (text, shown) in [
            ("no space: no space", "no space"),
            ("a: b: a: b", "a: b"),
            ("timed out", "timed out"),
            ("a: b", "a: b"),
            ("", ""),
        ] {
            assert_eq!(without_repetition(text), shown);
        }
    }

    #[test]
    fn only_denials_of_what_is_needed_end_a_connection() {
        let cluster: ClusterName = "team".parse().unwrap();
        let denied = |text: &str| is_denial(text, &cluster);
        assert!(denied(
            "Permissions Violation for Publish to \"$JS.API.CONSUMER.INFO.SPARRING_team_JOBS.audit\""
        ));
        assert!(denied("Permissions Violation for Publish to \"sparring.team.workers.a\""));
        assert!(denied("Permissions Violation for Publish to \"$JS.API.STREAM.INFO.KV_SPARRING_team_RUNS\""));
        assert!(denied("permissions violation for subscription to \"sparring.team.control.a\""));
        for other in [
            "Permissions Violation for Publish to \"$JS.API.STREAM.CREATE.OBJ_SPARRING_team_JOBS\"",
            "Permissions Violation for Publish to \"sparring.other.workers.a\"",
            "Permissions Violation for Publish to \"_INBOX.x\"",
            "maximum payload exceeded: sparring.team.jobs.audit.a",
        ] {
            assert!(!denied(other), "{other}");
        }
    }
}
