//! [`NamedSessions`]: sessions that several requests, and at most one connection, use by their key.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::time::Instant;

use super::client::ClientIdentity;
use super::session::Session;

/// Name of a session among the sessions of one client, so that clients cannot reach each other's sessions.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct SessionKey {
    client: Option<Arc<str>>,
    name: String,
}

impl SessionKey {
    /// Creates the key of a client's session.
    #[must_use]
    pub fn new(client: &ClientIdentity, name: impl Into<String>) -> Self {
        Self { client: client.name.clone(), name: name.into() }
    }

    /// Returns the name of the session.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Session that several requests use.
pub type SharedSession = Arc<tokio::sync::Mutex<Session>>;

/// Result of a request to close a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CloseOutcome {
    /// The session is closed.
    Closed,
    /// A connection is attached to the session, which closes when the connection ends.
    Closing,
    /// There is no session with the key.
    Unknown,
}

/// Reason why a connection cannot attach to a session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AttachError {
    /// There is no session with the name.
    #[error("Unknown session_id: {0}")]
    Unknown(String),
    /// Another connection is attached to the session.
    #[error("Session {0} already has an attached WebSocket")]
    Attached(String),
}

/// Session with a key.
#[derive(Debug)]
struct NamedSession {
    session: SharedSession,
    last_used: Instant,
    /// True while a connection is attached.
    is_attached: bool,
    /// True if the session closes when its connection ends.
    is_closing: bool,
}

/// All sessions with a key.
#[derive(Debug, Default)]
pub(super) struct NamedSessions(Mutex<HashMap<SessionKey, NamedSession>>);

impl NamedSessions {
    /// Returns the session with a key, if it exists.
    pub(super) fn get(&self, key: &SessionKey) -> Option<SharedSession> {
        let mut named = self.0.lock();
        let entry = named.get_mut(key)?;
        entry.last_used = Instant::now();
        Some(Arc::clone(&entry.session))
    }

    /// Adds a session and returns it. If two requests open a session at the same time, the first one stays and is returned.
    pub(super) fn add(&self, key: &SessionKey, session: Session) -> SharedSession {
        let new_entry = || NamedSession {
            session: Arc::new(tokio::sync::Mutex::new(session)),
            last_used: Instant::now(),
            is_attached: false,
            is_closing: false,
        };
        Arc::clone(&self.0.lock().entry(key.clone()).or_insert_with(new_entry).session)
    }

    /// Closes the session with a key, or lets it close when its connection ends.
    pub(super) fn close(&self, key: &SessionKey) -> CloseOutcome {
        let mut named = self.0.lock();
        match named.get_mut(key) {
            None => CloseOutcome::Unknown,
            Some(entry) if entry.is_attached => {
                entry.is_closing = true;
                CloseOutcome::Closing
            }
            Some(_) => {
                named.remove(key);
                CloseOutcome::Closed
            }
        }
    }

    /// Attaches a connection to the session with a key.
    pub(super) fn attach(self: &Arc<Self>, key: SessionKey) -> Result<AttachedSession, AttachError> {
        let mut named = self.0.lock();
        let Some(entry) = named.get_mut(&key) else { return Err(AttachError::Unknown(key.name)) };
        if entry.is_attached {
            return Err(AttachError::Attached(key.name));
        }
        entry.is_attached = true;
        let session = Arc::clone(&entry.session);
        Ok(AttachedSession { session, key, named: Arc::clone(self) })
    }

    /// Ends the attachment of a connection.
    fn detach(&self, key: &SessionKey) {
        let mut named = self.0.lock();
        let Some(entry) = named.get_mut(key) else { return };
        entry.is_attached = false;
        entry.last_used = Instant::now();
        if entry.is_closing {
            named.remove(key);
        }
    }

    /// Closes sessions that were not used for the idle timeout and are not in use now.
    pub(super) fn close_idle(&self, idle_timeout: Duration) {
        // A request or a connection that uses a session holds another reference to it.
        self.0.lock().retain(|_, entry| {
            entry.last_used.elapsed() < idle_timeout || Arc::strong_count(&entry.session) > 1
        });
    }

    /// Closes all sessions. Connections that are attached close theirs when they end.
    pub(super) fn close_all(&self) {
        self.0.lock().clear();
    }
}

/// Attachment of a connection to a session; it ends when this is dropped.
#[derive(Debug)]
pub struct AttachedSession {
    session: SharedSession,
    key: SessionKey,
    named: Arc<NamedSessions>,
}

impl AttachedSession {
    /// Returns the session of the attachment.
    #[must_use]
    pub const fn session(&self) -> &SharedSession {
        &self.session
    }

    /// Returns true if a request used the session within a time.
    #[must_use]
    pub fn was_used_within(&self, time: Duration) -> bool {
        self.named.0.lock().get(&self.key).is_some_and(|entry| entry.last_used.elapsed() < time)
    }
}

impl Drop for AttachedSession {
    fn drop(&mut self) {
        self.named.detach(&self.key);
    }
}
