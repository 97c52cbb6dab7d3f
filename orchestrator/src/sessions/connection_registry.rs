//! Registry of open connections by credential: closes them when their token expires or is revoked, or the server stops.

use std::collections::HashMap;

use parking_lot::Mutex;
use tokio::sync::watch;

/// Reason why the server closes a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CloseReason {
    /// The server is about to stop.
    ServerStopping,
    /// The token expired or was revoked, or the server has tokens now and the client has none.
    CredentialRevoked,
}

impl CloseReason {
    /// Returns the message for the client.
    #[must_use]
    pub const fn message(self) -> &'static str {
        match self {
            Self::ServerStopping => "the server is stopping",
            Self::CredentialRevoked => {
                "the token of the connection expired or was revoked, or the server now requires a token"
            }
        }
    }
}

/// Credential that a connection was opened with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Credential {
    /// The server had no tokens, so that none was needed.
    NoTokens,
    /// Token with this id.
    Token(i64),
}

/// Credentials of all open connections.
#[derive(Debug, Default)]
pub struct ConnectionRegistry(Mutex<HashMap<Credential, watch::Sender<bool>>>);

impl ConnectionRegistry {
    /// Returns the credentials of open connections and forgets those without connections.
    #[must_use]
    pub fn active_credentials(&self) -> Vec<Credential> {
        let mut credentials = self.0.lock();
        credentials.retain(|_, revoked| revoked.receiver_count() > 0);
        credentials.keys().copied().collect()
    }

    /// Closes every connection that was opened with this credential.
    pub fn close_connections(&self, credential: Credential) {
        if let Some(revoked) = self.0.lock().get(&credential) {
            revoked.send_replace(true);
        }
    }

    fn register(&self, credential: Credential) -> watch::Receiver<bool> {
        self.0.lock().entry(credential).or_default().subscribe()
    }
}

/// Signal that a connection must close.
#[derive(Debug)]
pub struct CloseSignal {
    stopping: watch::Receiver<bool>,
    revoked: Option<watch::Receiver<bool>>,
}

impl CloseSignal {
    /// Registers a connection. Without a credential only a stop of the server closes it.
    pub(super) fn new(
        stopping: watch::Receiver<bool>,
        registry: &ConnectionRegistry,
        credential: Option<Credential>,
    ) -> Self {
        Self { stopping, revoked: credential.map(|credential| registry.register(credential)) }
    }

    /// Returns the reason if the connection must close already.
    ///
    /// Connections that always have work and never wait poll this instead of [`Self::closed`].
    #[must_use]
    pub fn reason(&self) -> Option<CloseReason> {
        let is_revoked = self.revoked.as_ref().is_some_and(|revoked| *revoked.borrow());
        let is_stopping = *self.stopping.borrow();
        is_stopping
            .then_some(CloseReason::ServerStopping)
            .or(is_revoked.then_some(CloseReason::CredentialRevoked))
    }

    /// Waits until the connection must close, and returns the reason.
    pub async fn closed(&mut self) -> CloseReason {
        let Self { stopping, revoked } = self;
        let revoked = async {
            match revoked {
                // The sender lives as long as the server.
                Some(revoked) => drop(revoked.wait_for(|is_revoked| *is_revoked).await),
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            _ = stopping.wait_for(|is_stopping| *is_stopping) => CloseReason::ServerStopping,
            () = revoked => CloseReason::CredentialRevoked,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn revoked_credential_closes_only_its_connections() {
        let (stopping, registry) = (watch::Sender::new(false), ConnectionRegistry::default());
        let connect = |credential| CloseSignal::new(stopping.subscribe(), &registry, credential);
        let (mut first, mut second) =
            (connect(Some(Credential::Token(1))), connect(Some(Credential::Token(2))));
        let (mut without_token, mut always_allowed) = (connect(Some(Credential::NoTokens)), connect(None));
        let mut active = registry.active_credentials();
        active.sort_unstable();
        assert_eq!(active, [Credential::NoTokens, Credential::Token(1), Credential::Token(2)]);
        registry.close_connections(Credential::Token(1));
        registry.close_connections(Credential::Token(3)); // no connection has it
        let revoked = CloseReason::CredentialRevoked;
        assert_eq!((first.reason(), first.closed().await), (Some(revoked), revoked));
        assert_eq!((second.reason(), without_token.reason(), always_allowed.reason()), (None, None, None));
        registry.close_connections(Credential::NoTokens);
        assert_eq!(without_token.closed().await, revoked);
        stopping.send_replace(true);
        let stopped = CloseReason::ServerStopping;
        assert_eq!((second.closed().await, always_allowed.closed().await), (stopped, stopped));
        drop((first, second, without_token));
        assert!(registry.active_credentials().is_empty());
    }
}
