//! [`AppState`]: everything that request handlers share.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use policy_files::PolicyFolder;
use rollout::Endpoint;
use sqlx::SqlitePool;
use tokio::sync::watch;

use super::openenv::EpisodeBoards;
use super::readiness::ReadinessProbe;
use crate::alerts::AlertRules;
use crate::designs::Designers;
use crate::engine::writer::Writer;
use crate::leases::lease_service::LeaseService;
use crate::limits::{BodyLimit, ClientLimits, ConcurrencyLimits, LongPollLimit, Quota, RateLimit};
use crate::sessions::SessionManager;
use crate::shards::Shards;
use crate::trainer_activity::TrainerActivity;
use clock::Clock;
use llm_policy::judging::Judges;

/// State of the server that every request handler receives. Clones share it.
#[derive(Debug, Clone)]
pub struct AppState {
    /// Handle of the database's only writer.
    pub writer: Writer,
    /// Read-only connections to the database.
    pub readers: SqlitePool,
    /// Source of the current time.
    pub clock: Clock,
    /// Limits for each client.
    pub client_limits: ClientLimits,
    /// Service that grants leases and accepts results.
    pub lease_service: LeaseService,
    /// Shard of the server, and its peers.
    pub shards: Arc<Shards>,
    /// Activity of trainers in the last minutes.
    pub trainers: Arc<TrainerActivity>,
    /// Manager of the environments that run on the server.
    pub sessions: Arc<SessionManager>,
    /// True if OpenEnv's routes need no token.
    pub openenv_public: bool,
    /// Last states of web sessions, for their viewers.
    pub episode_boards: Arc<EpisodeBoards>,
    /// Limit on large request bodies: batches of results and columns.
    pub body_limit: BodyLimit,
    /// Signal of committed run events.
    pub events: Arc<watch::Sender<u64>>,
    /// Quota of event listeners.
    pub listeners: Arc<Quota>,
    /// Quota of answers with trajectories.
    pub feed_answers: Arc<Quota>,
    /// Limit on requests that log a trainer's metrics, for each run.
    pub metrics_rate: Arc<RateLimit>,
    /// Concurrency limits of expensive requests.
    pub concurrency: ConcurrencyLimits,
    /// Designers of new layouts.
    pub designers: Arc<dyn Designers>,
    /// Judges of the steps in sessions.
    pub judges: Arc<Judges>,
    /// Language model for chat policies, if one is configured.
    pub endpoint: Option<Endpoint>,
    /// Folder of policy files, if one is configured.
    pub policy_folder: PolicyFolder,
    /// True if the server publishes feeds on NATS.
    pub has_nats: bool,
    /// Limit on requests that wait for finished groups.
    pub long_polls: LongPollLimit,
    /// Rules by which alerts begin.
    pub alert_rules: AlertRules,
    /// True if a webhook receives messages about alerts.
    pub has_alert_webhook: bool,
    /// Check whether the database accepts writes.
    pub readiness: ReadinessProbe,
    /// When the server started.
    pub started: Instant,
    /// Folder of the database.
    pub folder: PathBuf,
    /// True once the server is stopping.
    pub stopping: Arc<AtomicBool>,
}
