//! The use cases between curriculum and store. What changes the database is a [`Change`], applied by the one
//! [`writer`]; what only computes (replay, brackets) happens before it, in parallel.

pub mod access;
pub mod audit;
mod bracket_view;
pub mod change_run;
mod close;
pub mod columns;
pub mod create_run;
pub mod criticise;
pub mod design;
pub mod desk;
pub mod ended;
pub mod eval_lease;
pub mod evaluation;
pub mod happening;
pub mod history;
pub mod jump;
pub mod lease;
mod mind;
pub mod prepare;
pub mod profile;
mod queue;
pub mod receipt;
mod refill;
pub mod report;
pub mod retain;
pub mod rollout;
pub mod sample;
pub mod sets;
pub(crate) mod setting_form;
pub mod settings;
pub mod standing;
pub mod status;
pub mod verdict;
pub mod version;
pub mod work;
pub mod writer;

pub use bracket_view::BracketView;
pub use desk::Desk;
pub use happening::Happening;
pub use mind::Mind;
pub use settings::RunSettings;
pub use work::{Wakes, Work};
pub use writer::{Change, Writer};

use crate::store::{StoreError, Trouble};
use curriculum::{RestoreError, SettingsError};

/// Why a use case was refused or failed.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// No such run.
    #[error("there is no run {0}")]
    UnknownRun(String),
    /// No such lease in this run.
    #[error("there is no lease {0} in this run")]
    UnknownLease(String),
    /// No such episode in this run.
    #[error("there is no episode {0} in this run")]
    UnknownEpisode(String),
    /// An episode of which only is kept how it came out.
    #[error("{0} is past what the run keeps whole: its actions and scenario are gone")]
    Expired(String),
    /// No such layout in this run, or at all.
    #[error("there is no layout {0} here")]
    UnknownLayout(String),
    /// No such evaluation.
    #[error("there is no evaluation eval-{0}")]
    UnknownEvaluation(i64),
    /// An evaluation that is complete.
    #[error("eval-{0} is complete: there is nothing to cancel")]
    EvaluationOver(i64),
    /// No such ask in this run.
    #[error("there is no ask {0} in this run")]
    UnknownAsk(String),
    /// A layout that never served.
    #[error("{0} was refused by the gate: it never serves")]
    Refused(String),
    /// More asks wait than a run may have.
    #[error("{0} asks wait or run, as many as may; come again when some are done")]
    TooManyAsks(i64),
    /// An id that is taken.
    #[error("a run {0} exists already")]
    RunExists(String),
    /// The run is paused.
    #[error("run {0} is paused; resume it to lease again")]
    Paused(String),
    /// A lease whose time is over, or that was released.
    #[error("lease {lease} is {status}; take another")]
    LeaseOver {
        /// The lease.
        lease: String,
        /// What became of it.
        status: String,
    },
    /// Columns that contradict those that came before.
    #[error("columns came for lease {0} before, and other ones; the first stand")]
    ClaimedOtherwise(String),
    /// A lease whose columns came.
    #[error(
        "the columns of lease {0} came; the logs of what is audited are due in its time, which is not renewed"
    )]
    AuditDue(String),
    /// More active leases than a run may have.
    #[error("the run has {0} active leases, as many as it may; report or release some")]
    TooManyLeases(i64),
    /// More active leases than a token may have.
    #[error("this token has {0} active leases, as many as it may; report or release some")]
    TooManyLeasesOfToken(u32),
    /// More runs than a token may create.
    #[error(
        "this token created {0} runs, as many as it may: use another, or start the server with a higher --runs-each"
    )]
    TooManyRuns(u32),
    /// Proposals are being prepared and do not come fast enough.
    #[error("scenarios are still being prepared; ask again in a moment")]
    NotReady,
    /// The queue of changes is full.
    #[error("more changes wait than can be written; ask again in a moment")]
    Busy,
    /// A field that cannot be.
    #[error("{field}: {reason}")]
    Invalid {
        /// The field at fault.
        field: String,
        /// What is wrong.
        reason: String,
    },
    /// A stored curriculum that cannot be brought back.
    #[error("the curriculum of the run cannot be restored: {0}")]
    Restore(#[from] RestoreError),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The batch this change was part of could not be committed; nothing of it was kept.
    #[error("the change could not be committed and was undone: {reason}")]
    NotCommitted {
        /// In the database's words.
        reason: String,
        /// Why, where it is for a while.
        trouble: Option<Trouble>,
    },
    /// The server is shutting down.
    #[error("the server is shutting down")]
    Stopping,
}

impl TrainingError {
    pub(crate) fn not_committed(error: &StoreError) -> Self {
        Self::NotCommitted { reason: error.to_string(), trouble: error.trouble() }
    }

    /// Whether it may be fine to do the same again, in a moment.
    #[must_use]
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Busy | Self::NotCommitted { .. }) || self.trouble().is_some()
    }

    /// Why the database cannot be used now, where that is for a while.
    #[must_use]
    pub fn trouble(&self) -> Option<Trouble> {
        match self {
            Self::Store(error) => error.trouble(),
            Self::NotCommitted { trouble, .. } => *trouble,
            _ => None,
        }
    }

    pub(crate) fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }
}

impl From<SettingsError> for TrainingError {
    fn from(error: SettingsError) -> Self {
        Self::Invalid { field: error.field, reason: error.reason }
    }
}

impl From<sqlx::Error> for TrainingError {
    fn from(error: sqlx::Error) -> Self {
        Self::Store(error.into())
    }
}
