//! [`SessionManager`]: opens and closes all sessions of a server, within its limits.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use store::ids::RunId;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::Instant;

use super::client::ClientIdentity;
use super::connection_registry::{CloseSignal, ConnectionRegistry};
use super::resumable::ResumableSessions;
use super::session::Session;
use super::session_leases::SessionLeases;
use super::vector::MemoryExceeded;
use crate::leases::lease_service::LeaseService;
use crate::limits::{Quota, QuotaExceeded, QuotaPermit};
use llm_policy::judging::Judges;

/// Maximum duration of the wait for open sessions at shutdown.
const SESSIONS_SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(2);

/// Limits of the sessions of a server.
#[derive(Debug, Clone, Copy)]
pub struct SessionLimits {
    /// Maximum number of open sessions.
    pub max_sessions: usize,
    /// Maximum number of open sessions for each token or address.
    pub max_per_client: usize,
    /// Time after which a silent session ends; `None` keeps silent sessions.
    pub idle_timeout: Option<Duration>,
    /// True if sessions may run episodes of runs.
    pub allow_runs: bool,
    /// Time during which a session can be resumed after a disconnect.
    pub resume_timeout: Duration,
    /// Memory for the environments of all vector sessions together, in MiB.
    pub memory_mib: u32,
}

impl Default for SessionLimits {
    fn default() -> Self {
        Self {
            max_sessions: 256,
            max_per_client: 64,
            idle_timeout: Some(Duration::from_secs(900)),
            allow_runs: true,
            resume_timeout: Duration::from_secs(60),
            memory_mib: 1024,
        }
    }
}

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
}

/// Session that several requests use by its key.
pub type SharedSession = Arc<tokio::sync::Mutex<Session>>;

/// Session with a key.
#[derive(Debug)]
struct NamedSession {
    session: SharedSession,
    last_used: Instant,
}

/// Manager of all sessions of a server.
#[derive(Debug)]
pub struct SessionManager {
    limits: SessionLimits,
    quota: Quota,
    /// Free memory for environments of vector sessions, in KiB.
    free_memory: Arc<Semaphore>,
    /// Threads that step the environments of vector sessions.
    pub(super) threads: Arc<rayon::ThreadPool>,
    resumable: ResumableSessions,
    pub(super) leases: Arc<SessionLeases>,
    judges: Arc<Judges>,
    named: Mutex<HashMap<SessionKey, NamedSession>>,
    stopping: watch::Sender<bool>,
    connections: ConnectionRegistry,
}

impl SessionManager {
    /// Creates a manager without sessions.
    #[must_use]
    pub fn new(
        limits: SessionLimits,
        lease_service: LeaseService,
        judges: Arc<Judges>,
        threads: Arc<rayon::ThreadPool>,
    ) -> Self {
        Self {
            limits,
            quota: Quota::new(limits.max_sessions, limits.max_per_client),
            free_memory: Arc::new(Semaphore::new(limits.memory_mib as usize * 1024)),
            threads,
            resumable: ResumableSessions::default(),
            leases: Arc::new(SessionLeases::new(lease_service, limits.allow_runs)),
            judges,
            named: Mutex::default(),
            stopping: watch::Sender::new(false),
            connections: ConnectionRegistry::default(),
        }
    }

    /// Returns the limits of sessions.
    #[must_use]
    pub const fn limits(&self) -> SessionLimits {
        self.limits
    }

    /// Returns the number of open sessions.
    #[must_use]
    pub fn active(&self) -> usize {
        self.quota.in_use()
    }

    /// Returns the registry of sessions that can be resumed.
    #[must_use]
    pub const fn resumable(&self) -> &ResumableSessions {
        &self.resumable
    }

    /// Returns the registry of open connections.
    #[must_use]
    pub const fn connections(&self) -> &ConnectionRegistry {
        &self.connections
    }

    /// Opens a session. It is closed when it is dropped.
    ///
    /// # Errors
    /// Returns [`QuotaExceeded`] if too many sessions are open, in total or of the client.
    pub fn open(&self, client: &ClientIdentity) -> Result<Session, QuotaExceeded> {
        let permit = self.acquire_permit(client)?;
        Ok(Session::new(permit, client.clone(), Arc::clone(&self.leases), Arc::clone(&self.judges)))
    }

    /// Returns the session with a key, and opens it if it does not exist.
    ///
    /// # Errors
    /// Returns [`QuotaExceeded`] if too many sessions are open, in total or of the client.
    pub fn get_or_open(
        &self,
        client: &ClientIdentity,
        key: &SessionKey,
    ) -> Result<SharedSession, QuotaExceeded> {
        if let Some(session) = self.get(key) {
            return Ok(session);
        }
        let session = Arc::new(tokio::sync::Mutex::new(self.open(client)?));
        let mut named = self.named.lock();
        // Two requests may have opened it at the same time: the first session stays.
        let entry =
            named.entry(key.clone()).or_insert_with(|| NamedSession { session, last_used: Instant::now() });
        Ok(Arc::clone(&entry.session))
    }

    /// Returns the session with a key, if it exists.
    #[must_use]
    pub fn get(&self, key: &SessionKey) -> Option<SharedSession> {
        self.close_idle();
        let mut named = self.named.lock();
        let entry = named.get_mut(key)?;
        entry.last_used = Instant::now();
        Some(Arc::clone(&entry.session))
    }

    /// Closes the session with a key. Returns false if it does not exist.
    pub fn close(&self, key: &SessionKey) -> bool {
        self.named.lock().remove(key).is_some()
    }

    /// Returns a signal for a connection of the client: the server stops, or the client's token expires or is revoked.
    #[must_use]
    pub fn close_signal(&self, client: &ClientIdentity) -> CloseSignal {
        CloseSignal::new(self.stopping.subscribe(), &self.connections, client.credential())
    }

    /// Ends the episodes of a deleted run: their next steps fail.
    pub fn end_run(&self, run: &RunId) {
        self.leases.end_run(run);
    }

    /// Closes all sessions and waits for them, for two seconds at most. Unfinished episodes are returned to their leases.
    pub async fn shut_down(&self) {
        self.stopping.send_replace(true);
        self.named.lock().clear();
        // Connections close their own sessions, which takes a moment.
        let closed = tokio::time::timeout(SESSIONS_SHUTDOWN_TIMEOUT, self.quota.wait_until_unused()).await;
        if closed.is_err() {
            tracing::warn!(active = self.active(), "Some sessions did not end in time.");
        }
        self.leases.wait_for_pending().await;
    }

    /// Takes a permit for a session; closes idle sessions if none is free.
    pub(super) fn acquire_permit(&self, client: &ClientIdentity) -> Result<QuotaPermit, QuotaExceeded> {
        self.quota.acquire(client.name.as_ref()).or_else(|_| {
            self.close_idle();
            self.quota.acquire(client.name.as_ref())
        })
    }

    /// Reserves memory for environments until the permit is dropped.
    pub(super) fn reserve_memory(&self, bytes: usize) -> Result<OwnedSemaphorePermit, MemoryExceeded> {
        let kib = u32::try_from(bytes.div_ceil(1024)).unwrap_or(u32::MAX);
        Arc::clone(&self.free_memory).try_acquire_many_owned(kib).map_err(|_| MemoryExceeded {
            needed_mib: bytes.div_ceil(1 << 20),
            free_mib: self.free_memory.available_permits() / 1024,
            limit_mib: self.limits.memory_mib as usize,
        })
    }

    /// Closes named sessions that were not used for the idle timeout.
    fn close_idle(&self) {
        let Some(idle_timeout) = self.limits.idle_timeout else { return };
        // A request that uses a session holds another reference to it.
        self.named.lock().retain(|_, entry| {
            entry.last_used.elapsed() < idle_timeout || Arc::strong_count(&entry.session) > 1
        });
    }
}
