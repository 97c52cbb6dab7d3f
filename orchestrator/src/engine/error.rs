//! The error of every use case of the service.

use curriculum::{RestoreError, SettingsError};
use store::leases::LeaseStatus;
use store::{Outage, StoreError};

/// Error of a use case.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The run does not exist.
    #[error("run {0} does not exist; GET /v1/runs lists the runs")]
    UnknownRun(String),
    /// The run has no such lease.
    #[error("the run has no lease {0}")]
    UnknownLease(String),
    /// The run has no such episode.
    #[error("the run has no episode {0}")]
    UnknownEpisode(String),
    /// The run keeps only the result of the episode.
    #[error("{0} was compacted; its actions and scenario were deleted")]
    Expired(String),
    /// The run has no such layout.
    #[error("layout {0} does not exist")]
    UnknownLayout(String),
    /// The evaluation does not exist.
    #[error("evaluation eval-{0} does not exist")]
    UnknownEvaluation(i64),
    /// The evaluation is complete.
    #[error("evaluation eval-{0} is complete and cannot be cancelled")]
    EvaluationEnded(i64),
    /// The run has no such design request.
    #[error("the run has no design request {0}")]
    UnknownDesignRequest(String),
    /// The gate refused the layout.
    #[error("the gate refused {0}, so it cannot be leased or restored")]
    Refused(String),
    /// The run has as many waiting design requests as it may have.
    #[error("the run has {0} unfinished design requests, the maximum; retry when one has ended")]
    TooManyDesignRequests(i64),
    /// The run id is taken.
    #[error("run {0} already exists; choose another id")]
    RunExists(String),
    /// The run with this id is being deleted.
    #[error("run {0} is being deleted; choose another id, or retry when the deletion is complete")]
    RunBeingDeleted(String),
    /// A run is deleted only after it was archived.
    #[error("run {0} must be archived before it is deleted; archive it with POST /v1/runs/{0}/archive")]
    RunNotArchived(String),
    /// The name that confirms a deletion is not that of the run.
    #[error("must be the name of run {run}, got {name:?}; GET /v1/runs/{run} returns the name")]
    RunNameMismatch {
        /// Id of the run.
        run: String,
        /// Name in the request.
        name: String,
    },
    /// The run is paused and grants no leases.
    #[error("run {0} is paused; resume it to create leases")]
    Paused(String),
    /// The trainer has not begun the group of the episode, so its scenario is not disclosed; holds the id of the episode.
    #[error("the group of episode {0} is not begun; begin the group first")]
    NotBegun(String),
    /// The lease has ended.
    #[error("lease {lease} is {status}; create another lease")]
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
        "lease {0} cannot be renewed after its columns were claimed; report the logs of its audited groups before it expires"
    )]
    AuditDue(String),
    /// The lease belongs to another principal.
    #[error("lease {0} belongs to another principal; use a token of an admin or of its owner")]
    ForeignLease(String),
    /// The client's principal is neither the owner nor a member of the run.
    #[error(
        "run {run} belongs to the principal {owner:?}, and the token's principal is no member; \
         the owner or an admin can add it with PUT /v1/runs/{run}/members or `sparring runs members`"
    )]
    NotRunMember {
        /// Id of the run.
        run: String,
        /// Name of the run's owner.
        owner: String,
    },
    /// The operation is for the owner of the run.
    #[error(
        "run {run} belongs to the principal {owner:?}; only a token of this principal or of an admin can change the run"
    )]
    NotRunOwner {
        /// Id of the run.
        run: String,
        /// Name of the run's owner.
        owner: String,
    },
    /// The operation is for the owner of the run, and the run has none.
    #[error(
        "run {0} has no owner, so only an admin can change it; an admin can set its owner with PUT /v1/runs/{0}/members"
    )]
    RunWithoutOwner(String),
    /// The owner of a run is set by admins.
    #[error("only an admin can set the owner of a run; leave `owner` out to set the members")]
    OwnerNeedsAdmin,
    /// The evaluation belongs to another principal.
    #[error(
        "evaluation eval-{0} belongs to another principal; use a token of an admin, or of the principal that created it"
    )]
    ForeignEvaluation(i64),
    /// The run has as many active leases as it may have.
    #[error("the run has {0} active leases, the maximum; report or release one")]
    TooManyLeases(i64),
    /// The principal has as many active leases as it may have.
    #[error("the principal of the token has {0} active leases, the maximum; report or release one")]
    TooManyLeasesOfPrincipal(u32),
    /// The principal owns as many runs as it may.
    #[error(
        "the principal of the token owns {0} runs, the maximum; delete one, or start the server with a larger --runs-each"
    )]
    TooManyRuns(u32),
    /// No prepared scenario became available in time.
    #[error("the server is still preparing scenarios; retry in a second")]
    NotReady,
    /// The queue of the writer is full.
    #[error("the queue of the writer is full; retry in a second")]
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

    /// The error of a change that waits for something that cannot happen during an outage.
    pub(crate) fn unavailable(outage: Outage) -> Self {
        Self::NotCommitted { reason: outage.to_string(), outage: Some(outage) }
    }

    /// True if the same request may succeed a moment later.
    #[must_use]
    pub fn is_temporary(&self) -> bool {
        matches!(self, Self::Busy | Self::NotCommitted { .. } | Self::Store(StoreError::ReadersBusy))
            || self.outage().is_some()
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
