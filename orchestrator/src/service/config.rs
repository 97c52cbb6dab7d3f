//! Configuration of the service, and the errors of its start.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use job_queue::nats::NatsConfig;
use policy_files::PolicyFolder;
use rollout::Endpoint;
use store::shard::Shard;
use store::{OpenError, StoreError};

use crate::alerts::AlertSettings;
use crate::designs::{BuiltInDesigners, Designers};
use crate::http::{TlsError, TlsFiles};
use crate::limits::ClientLimits;
use crate::retention::archived::ArchivedRetention;
use crate::sessions::SessionLimits;
use crate::shards::{InvalidPeers, PeerServer};
use crate::tokens::Token;
use clock::Clock;
use llm_policy::judging::Judges;

/// Configuration of the service.
#[derive(Debug, Clone)]
pub struct Config {
    /// Address to listen on; port 0 selects a free port.
    pub bind: SocketAddr,
    /// Files of the server's certificate. Without them connections are not encrypted.
    pub tls: Option<TlsFiles>,
    /// Path of the database file, which is created if it does not exist.
    pub db: PathBuf,
    /// Source of the current time.
    pub clock: Clock,
    /// Designers of new layouts.
    pub designers: Arc<dyn Designers>,
    /// Limits of all sessions.
    pub sessions: SessionLimits,
    /// Judges of the steps in sessions.
    pub judges: Arc<Judges>,
    /// Language model for runs with the policy `chat`, if one is configured.
    pub endpoint: Option<Endpoint>,
    /// Folder of policy files that clients can evaluate and roll out, if one is configured.
    pub policy_folder: PolicyFolder,
    /// True if OpenEnv's routes need no token. A server without tokens then serves only these routes.
    pub openenv_public: bool,
    /// Limits for each client.
    pub client_limits: ClientLimits,
    /// How long archived runs are kept; `None` keeps them for ever.
    pub archived_retention: Option<ArchivedRetention>,
    /// Rules of alerts, and their webhook.
    pub alerts: AlertSettings,
    /// Workers on other machines, and NATS, which carries their jobs and trajectory feeds; `None` if the server does all jobs itself.
    pub remote_workers: Option<RemoteWorkersConfig>,
    /// Shard of the server; `None` for the one that the database remembers, if it has one.
    pub shard: Option<Shard>,
    /// Other servers of the team, whose runs are merged into lists.
    pub peers: Vec<PeerServer>,
    /// Token of the process that starts the service for itself; `None` for a server. With it, no worker runs, the state of the
    /// last server is not recovered, and only requests with this token are admitted, as an admin's.
    pub process_token: Option<Token>,
}

impl Config {
    /// Returns the configuration of a server on a free loopback port, with default limits and without a model.
    #[must_use]
    pub fn local(db: PathBuf) -> Self {
        Self {
            bind: SocketAddr::from(([127, 0, 0, 1], 0)),
            tls: None,
            db,
            clock: Clock::system(),
            designers: Arc::new(BuiltInDesigners),
            sessions: SessionLimits::default(),
            judges: Arc::default(),
            endpoint: None,
            policy_folder: PolicyFolder::default(),
            openenv_public: false,
            client_limits: ClientLimits::default(),
            archived_retention: None,
            alerts: AlertSettings::default(),
            remote_workers: None,
            shard: None,
            peers: Vec::new(),
            process_token: None,
        }
    }

    /// Returns the configuration of a service that this process starts for itself, to read or change a database while no
    /// server runs. The token admits its requests.
    #[must_use]
    pub fn for_this_process(db: PathBuf) -> Self {
        Self { process_token: Some(Token::for_process()), ..Self::local(db) }
    }
}

/// Workers on other machines, and the trust in them.
#[derive(Debug, Clone)]
pub struct RemoteWorkersConfig {
    /// How to reach NATS.
    pub nats: NatsConfig,
    /// Share of results that the server recomputes, from 0 to 1.
    pub verified_share: f64,
    /// Jobs whose expected time is shorter stay in the server.
    pub min_job: Duration,
    /// Time after which the server does a job itself that no worker works on.
    pub patience: Duration,
}

/// Reason why the service could not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The database cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The state that the last server left cannot be read or repaired.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Other hosts can reach the address, and the server has no tokens.
    #[error(
        "other hosts can reach {0}, but the server has no tokens; create one with `sparring token create`, bind a loopback address such as 127.0.0.1:8700, or serve only OpenEnv's routes with --openenv-public"
    )]
    NoTokens(SocketAddr),
    /// Other hosts can reach the address, and none of the server's tokens is valid.
    #[error(
        "other hosts can reach {0}, but every token has expired or was revoked (see `sparring token list`); create one with `sparring token create`"
    )]
    NoValidTokens(SocketAddr),
    /// The database has another shard.
    #[error(
        "{db} belongs to the shard {stored}, and the ids of its runs begin with it: start the server with --shard {stored}, or give the database of the shard {given} with --db"
    )]
    OtherShard {
        /// Path of the database.
        db: String,
        /// Shard that the database remembers.
        stored: Shard,
        /// Shard from the configuration.
        given: Shard,
    },
    /// The peers do not fit together.
    #[error(transparent)]
    Peers(#[from] InvalidPeers),
    /// The system cannot start more threads.
    #[error("background threads cannot be started: {0}")]
    Threads(rayon::ThreadPoolBuildError),
    /// The files of the certificate cannot be used.
    #[error(transparent)]
    Tls(#[from] TlsError),
    /// The address cannot be listened on.
    #[error("the server cannot listen on {address}: {}", listen_remedy(*address, reason))]
    Listen {
        /// Address from the configuration.
        address: SocketAddr,
        /// Error of the operating system.
        reason: std::io::Error,
    },
}

/// Says why an address cannot be listened on, and what helps.
fn listen_remedy(address: SocketAddr, reason: &std::io::Error) -> String {
    match reason.kind() {
        std::io::ErrorKind::AddrInUse => format!(
            "another program uses port {}; stop it, or choose another port with --port (0 for a free one)",
            address.port()
        ),
        std::io::ErrorKind::PermissionDenied => {
            format!("port {} needs privileges; choose a port above 1023 with --port", address.port())
        }
        std::io::ErrorKind::AddrNotAvailable => {
            "this machine does not have that address; choose one of its addresses with --bind, or 0.0.0.0 for all"
                .to_owned()
        }
        _ => reason.to_string(),
    }
}
