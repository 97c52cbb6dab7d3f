//! [`SessionManager`]: opens and closes all sessions of a server, within its limits.

use std::sync::Arc;
use std::time::Duration;

use store::ids::RunId;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use uuid::Uuid;

use super::client::ClientIdentity;
use super::connection_registry::{CloseSignal, ConnectionRegistry};
use super::named_sessions::{
    AttachError, AttachedSession, CloseOutcome, NamedSessions, SessionKey, SharedSession,
};
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
    named: Arc<NamedSessions>,
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
            named: Arc::default(),
            stopping: watch::Sender::new(false),
            connections: ConnectionRegistry::default(),
        }
    }

    /// Returns the limits of sessions.
    #[must_use]
    pub const fn limits(&self) -> SessionLimits {
        self.limits
    }

    /// Returns the number of open sessions. Idle ones are closed first.
    #[must_use]
    pub fn active(&self) -> usize {
        self.close_idle();
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
        self.open_with_id(client, Uuid::new_v4().to_string())
    }

    fn open_with_id(&self, client: &ClientIdentity, id: String) -> Result<Session, QuotaExceeded> {
        let permit = self.acquire_permit(client)?;
        Ok(Session::new(id, permit, client.clone(), Arc::clone(&self.leases), Arc::clone(&self.judges)))
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
        let session = self.open_with_id(client, key.name().to_owned())?;
        Ok(self.named.add(key, session))
    }

    /// Returns the session with a key, if it exists.
    #[must_use]
    pub fn get(&self, key: &SessionKey) -> Option<SharedSession> {
        self.close_idle();
        self.named.get(key)
    }

    /// Attaches a connection to the session with a key, which outlives the connection.
    ///
    /// # Errors
    /// Returns [`AttachError`] if there is no such session, or if another connection is attached to it.
    pub fn attach(&self, key: SessionKey) -> Result<AttachedSession, AttachError> {
        self.close_idle();
        self.named.attach(key)
    }

    /// Closes the session with a key, or lets it close when its connection ends.
    pub fn close(&self, key: &SessionKey) -> CloseOutcome {
        self.named.close(key)
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
        self.named.close_all();
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
        self.named.close_idle(idle_timeout);
    }
}
