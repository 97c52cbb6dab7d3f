//! The error of every use case of the service.

use curriculum::{RestoreError, SettingsError};
use store::leases::LeaseStatus;
use store::{Outage, StoreError};

/// Error of a use case.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The run does not exist.
    #[error("there is no run {0}")]
    UnknownRun(String),
    /// The run has no such lease.
    #[error("there is no lease {0} in this run")]
    UnknownLease(String),
    /// The run has no such episode.
    #[error("there is no episode {0} in this run")]
    UnknownEpisode(String),
    /// The run keeps only the result of the episode.
    #[error("{0} was compacted: its actions and scenario were deleted")]
    Expired(String),
    /// The run has no such layout.
    #[error("there is no layout {0} here")]
    UnknownLayout(String),
    /// The evaluation does not exist.
    #[error("there is no evaluation eval-{0}")]
    UnknownEvaluation(i64),
    /// The evaluation is complete.
    #[error("eval-{0} is complete: there is nothing to cancel")]
    EvaluationEnded(i64),
    /// The run has no such design request.
    #[error("there is no design request {0} in this run")]
    UnknownDesignRequest(String),
    /// The gate refused the layout.
    #[error("the gate refused {0}, so it cannot be leased or restored")]
    Refused(String),
    /// The run has as many waiting design requests as it may have.
    #[error("{0} design requests wait or run, the most that are allowed; retry when some have ended")]
    TooManyDesignRequests(i64),
    /// The run id is taken.
    #[error("a run {0} exists already")]
    RunExists(String),
    /// The run is paused and grants no leases.
    #[error("run {0} is paused; resume it to lease again")]
    Paused(String),
    /// The lease has ended.
    #[error("lease {lease} is {status}; take another")]
    LeaseClosed {
        /// Id of the lease.
        lease: String,
        /// Status in which it ended.
        status: LeaseStatus,
    },
    /// The lease has other columns already.
    #[error("lease {0} already has different columns; the first submission was kept")]
    ColumnsConflict(String),
    /// The lease cannot be renewed because its columns were received.
    #[error(
        "the columns of lease {0} were received; the logs of the audited groups are due before it ends, and it cannot be renewed"
    )]
    AuditDue(String),
    /// The run has as many active leases as it may have.
    #[error("the run has {0} active leases, as many as it may; report or release some")]
    TooManyLeases(i64),
    /// The token has as many active leases as it may have.
    #[error("this token has {0} active leases, as many as it may; report or release some")]
    TooManyLeasesOfToken(u32),
    /// The token has created as many runs as it may.
    #[error(
        "this token created {0} runs, as many as it may: use another, or start the server with a higher --runs-each"
    )]
    TooManyRuns(u32),
    /// No prepared scenario became available in time.
    #[error("scenarios are still being prepared; ask again in a moment")]
    NotReady,
    /// The queue of the writer is full.
    #[error("more changes wait than can be written; ask again in a moment")]
    Busy,
    /// A field has an invalid value.
    #[error("{field}: {reason}")]
    Invalid {
        /// Path of the field.
        field: String,
        /// Reason, and how to fix it.
        reason: String,
    },
    /// The stored curriculum cannot be restored.
    #[error("the curriculum of the run cannot be restored: {0}")]
    Restore(#[from] RestoreError),
    /// The store returned an error.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The transaction of the change could not be committed; nothing of it was kept.
    #[error("the change could not be committed and was undone: {reason}")]
    NotCommitted {
        /// Message of the database.
        reason: String,
        /// Temporary cause, if there is one.
        outage: Option<Outage>,
    },
    /// The server shuts down.
    #[error("the server is shutting down")]
    Stopping,
}

impl ServiceError {
    pub(crate) fn not_committed(error: &StoreError) -> Self {
        Self::NotCommitted { reason: error.to_string(), outage: error.outage() }
    }

    /// True if the same request may succeed a moment later.
    #[must_use]
    pub fn is_temporary(&self) -> bool {
        matches!(self, Self::Busy | Self::NotCommitted { .. }) || self.outage().is_some()
    }

    /// Returns the temporary cause if the database cannot be used now.
    #[must_use]
    pub fn outage(&self) -> Option<Outage> {
        match self {
            Self::Store(error) => error.outage(),
            Self::NotCommitted { outage, .. } => *outage,
            _ => None,
        }
    }

    pub(crate) fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }
}

impl From<SettingsError> for ServiceError {
    fn from(error: SettingsError) -> Self {
        Self::Invalid { field: error.field, reason: error.reason }
    }
}

impl From<sqlx::Error> for ServiceError {
    fn from(error: sqlx::Error) -> Self {
        Self::Store(error.into())
    }
}
