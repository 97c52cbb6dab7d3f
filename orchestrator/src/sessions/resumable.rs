//! Sessions that outlive their connection: after a disconnect they wait for a client that resumes them.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Bytes;
use parking_lot::Mutex;
use tokio::sync::{OwnedMutexGuard, watch};

use super::client::ClientIdentity;
use super::connection_registry::CloseSignal;
use super::session::Session;
use super::session_request::SessionRequest;
use super::vector::VectorSession;

/// Interval at which a silent session checks whether to renew its lease. Leases may last as little as one second.
pub const LEASE_CHECK_INTERVAL: Duration = Duration::from_millis(300);

/// Session that a client can resume.
#[derive(Debug)]
pub enum ResumableSession {
    /// One environment, stepped by text messages.
    Single(Box<SingleSession>),
    /// Many environments, stepped by binary frames.
    Vector(Box<VectorSession>),
}

/// One environment that is stepped by numbered messages.
#[derive(Debug)]
pub struct SingleSession {
    /// Session with the environment.
    pub session: Session,
    /// Request of the last reset.
    pub request: SessionRequest,
    /// Reply to the last message that changed the session.
    pub last_reply: Option<LastReply>,
}

/// Reply that is kept so that it can be sent again.
#[derive(Debug, Clone)]
pub struct LastReply {
    /// Number of the message that was answered.
    pub id: u64,
    /// Text of the reply.
    pub text: Bytes,
}

impl ResumableSession {
    /// Returns the secret id by which a client resumes the session.
    #[must_use]
    pub fn token(&self) -> &str {
        match self {
            Self::Single(single) => single.session.id(),
            Self::Vector(vector) => vector.token(),
        }
    }

    /// Renews the session's lease if a third of its time is over.
    pub async fn renew_lease(&mut self) {
        match self {
            Self::Single(single) => single.session.renew_lease().await,
            Self::Vector(vector) => vector.renew_lease().await,
        }
    }
}

/// Entry of a session, shared by the registry and the connections that want the session.
#[derive(Debug)]
struct SessionEntry {
    /// The session; `None` after its end. The connection that serves the session holds the lock.
    session: Arc<tokio::sync::Mutex<Option<ResumableSession>>>,
    /// Number of connections that attached to the session after the first; the latest one owns it.
    attachments: watch::Sender<u64>,
    /// Client that may resume the session.
    owner: ClientIdentity,
}

type SessionEntries = Arc<Mutex<HashMap<String, Arc<SessionEntry>>>>;

/// Registry of all sessions that can be resumed, by their token.
#[derive(Debug, Default)]
pub struct ResumableSessions(SessionEntries);

/// Reason why a session cannot be resumed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ResumeError {
    /// The client has no session with this token.
    #[error("the session does not exist: it was never opened, or it ended")]
    Unknown,
    /// A later connection resumed the session.
    #[error("another connection resumed this session")]
    Superseded,
}

/// Exclusive access of one connection to a session.
///
/// Dropping it ends the session, unless a later connection attached to it.
#[derive(Debug)]
pub struct SessionAttachment {
    entries: SessionEntries,
    entry: Arc<SessionEntry>,
    session: OwnedMutexGuard<Option<ResumableSession>>,
    attachments: watch::Receiver<u64>,
    /// Value of `attachments` while this attachment is the latest.
    number: u64,
}

impl ResumableSessions {
    /// Registers a session that was just opened and attaches to it; `None` only if the new lock is taken, which cannot be.
    #[must_use]
    pub fn register(&self, session: ResumableSession, owner: &ClientIdentity) -> Option<SessionAttachment> {
        let token = session.token().to_owned();
        let entry = Arc::new(SessionEntry {
            session: Arc::new(tokio::sync::Mutex::new(Some(session))),
            attachments: watch::Sender::new(0),
            owner: owner.clone(),
        });
        // The entry is not registered yet, so that its lock is free.
        let guard = Arc::clone(&entry.session).try_lock_owned().ok()?;
        self.0.lock().insert(token, Arc::clone(&entry));
        let attachments = entry.attachments.subscribe();
        Some(SessionAttachment {
            entries: Arc::clone(&self.0),
            entry,
            session: guard,
            attachments,
            number: 0,
        })
    }

    /// Attaches to a session of `owner`. Signals the connection that serves the session, and waits until it has finished its
    /// current message and released the session.
    ///
    /// The caller must await the result: after the signal only the new attachment keeps the session alive.
    ///
    /// # Errors
    /// Returns [`ResumeError::Unknown`] if `owner` has no such session or it ended, and [`ResumeError::Superseded`] if a later
    /// connection attached meanwhile.
    pub async fn resume(
        &self,
        token: &str,
        owner: &ClientIdentity,
    ) -> Result<SessionAttachment, ResumeError> {
        let entry = self.0.lock().get(token).filter(|entry| entry.owner == *owner).cloned();
        let entry = entry.ok_or(ResumeError::Unknown)?;
        let mut number = 0;
        entry.attachments.send_modify(|attachments| {
            *attachments += 1;
            number = *attachments;
        });
        let attachments = entry.attachments.subscribe();
        let session = Arc::clone(&entry.session).lock_owned().await;
        if session.is_none() {
            return Err(ResumeError::Unknown);
        }
        if *attachments.borrow() != number {
            return Err(ResumeError::Superseded);
        }
        Ok(SessionAttachment { entries: Arc::clone(&self.0), entry, session, attachments, number })
    }
}

impl SessionAttachment {
    /// Returns the session; `None` after its end.
    pub fn session(&mut self) -> Option<&mut ResumableSession> {
        self.session.as_mut()
    }

    /// Returns true if a later connection attached to the session.
    #[must_use]
    pub fn is_superseded(&self) -> bool {
        *self.attachments.borrow() != self.number
    }

    /// Waits until a later connection attaches to the session.
    pub async fn superseded(&mut self) {
        let number = self.number;
        // The entry holds the sender, and `self` holds the entry, so that the channel stays open.
        drop(self.attachments.wait_for(|attachments| *attachments != number).await);
    }

    /// Keeps the session and its lease for `timeout` after a disconnect. Ends the session if no client resumes it, or if the
    /// connection would have to close.
    pub async fn wait_for_resume(mut self, timeout: Duration, mut close_signal: CloseSignal) {
        let deadline = tokio::time::sleep(timeout);
        tokio::pin!(deadline);
        loop {
            tokio::select! {
                () = self.superseded() => return,
                _ = close_signal.closed() => return,
                () = &mut deadline => return,
                () = tokio::time::sleep(LEASE_CHECK_INTERVAL) => {
                    if let Some(session) = self.session() {
                        session.renew_lease().await;
                    }
                }
            }
        }
    }
}

impl Drop for SessionAttachment {
    fn drop(&mut self) {
        if self.is_superseded() {
            return;
        }
        // A connection that attaches from here on finds no session.
        if let Some(session) = self.session.take() {
            let mut entries = self.entries.lock();
            if entries.get(session.token()).is_some_and(|entry| Arc::ptr_eq(entry, &self.entry)) {
                entries.remove(session.token());
            }
        }
    }
}
