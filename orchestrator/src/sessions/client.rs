//! The identity of a client, as sessions and their limits see it.

use std::sync::Arc;

use super::connection_registry::Credential;
use crate::ownership::Actor;

/// Identity of a client that opens sessions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ClientIdentity {
    /// Name of the token or address of the client; `None` if clients are not distinguished.
    pub name: Option<Arc<str>>,
    /// Principal and rights of the client.
    pub actor: Actor,
    /// Id of the client's token, if it has one.
    pub token: Option<i64>,
    /// True if the client's sessions may run episodes of runs.
    pub may_use_runs: bool,
}

impl ClientIdentity {
    /// Identity of every client of a server without tokens, which listens on loopback only.
    #[must_use]
    pub const fn local() -> Self {
        Self { name: None, actor: Actor::Local, token: None, may_use_runs: true }
    }

    /// Returns the credential that the client's connections depend on.
    ///
    /// `None` if the client may connect without a token even if the server has tokens.
    pub(super) fn credential(&self) -> Option<Credential> {
        match (self.token, &self.name) {
            (Some(token), _) => Some(Credential::Token(token)),
            (None, None) => Some(Credential::NoTokens),
            (None, Some(_)) => None,
        }
    }
}
