//! Environments that run on the server, one or many in each session, for clients without `env-core`.
//!
//! [`SessionManager`] opens sessions for every transport (`/v1/sessions`, OpenEnv over HTTP, WebSocket and MCP) and holds
//! their limits. A [`Session`] has one environment, a [`VectorSession`] many that are stepped by binary frames. A session
//! that runs episodes of a run takes a lease and reports outcomes like a trainer (`session_leases`).
//! `resumable` keeps sessions over a disconnect, and `connection_registry` closes connections.
//!
//! The protocols themselves are in `http`, judges are in `judging`. Start reading at [`SessionManager`].

mod abandon;
mod client;
mod connection_registry;
mod judged_score;
mod manager;
mod named_sessions;
mod open_vector;
mod resumable;
mod session;
mod session_leases;
mod session_request;
pub mod vector;

pub use self::client::ClientIdentity;
pub use self::connection_registry::{CloseReason, CloseSignal, ConnectionRegistry, Credential};
pub use self::judged_score::JudgedScore;
pub use self::manager::{SessionLimits, SessionManager};
pub use self::named_sessions::{AttachError, AttachedSession, CloseOutcome, SessionKey, SharedSession};
pub use self::resumable::{
    LEASE_CHECK_INTERVAL, LastReply, ResumableSession, ResumableSessions, ResumeError, SessionAttachment,
    SingleSession,
};
pub use self::session::{ReportOutcome, Session, SessionError, SessionStatus, StepView};
pub use self::session_leases::SESSION_LEASE_TTL_S;
pub use self::session_request::{
    EpisodeSource, MAX_NAME_CHARS, SessionRequest, SessionRequestError, SuiteScenario,
};
pub use self::vector::{EpisodeTally, VectorError, VectorRequest, VectorSession, VectorSource};
