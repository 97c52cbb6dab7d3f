//! Events of a run, in commit order, as listeners of `/v1/runs/{run}/events` receive them.

use serde::Serialize;
use store::columns::ClaimState;
use store::design_requests::DesignerKind;
use store::events::{EventKind, NewEvent};
use store::groups::{GroupRole, GroupRow, GroupState};
use store::leases::{LeaseForm, LeaseRow, Purpose};
use store::to_json;

use crate::engine::error::ServiceError;
use crate::engine::outbox::Outbox;
use crate::engine::run_state::move_kind;
use crate::metrics::{self, LeaseEvent};
use clock::Millis;
use curriculum::LevelMove;

/// An event of a run; its fields are the body that listeners receive.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum RunEvent<'a> {
    /// The run was created, changed, tagged, paused, resumed or archived.
    Run {
        /// `created`, `changed` (other settings), `tagged` (other tags), `paused`, `resumed` or `archived`.
        state: &'a str,
    },
    /// A lease was created or changed its state.
    Lease {
        /// Id of the lease.
        lease: String,
        /// What happened to it.
        state: LeaseEvent,
        /// Purpose of its episodes.
        purpose: Purpose,
        /// Form of the lease: `groups` or `columns`.
        form: LeaseForm,
        /// Number of leased groups.
        groups: i64,
        /// Number of episodes in each group.
        group_size: i64,
    },
    /// Group that closed, with its outcome.
    Group {
        /// Id of its lease.
        lease: String,
        /// Number of the group in its lease, from 0.
        group: i64,
        /// Id of the task.
        task: &'a str,
        /// Level of the task; `None` for strategies without levels.
        level: Option<i64>,
        /// Role of the proposal behind the group.
        role: GroupRole,
        /// `complete`, `partial` or `lost`.
        state: GroupState,
        /// True if the scenario is contested.
        contested: bool,
        /// Number of finished episodes.
        finished: i64,
        /// Number of successful episodes.
        successes: i64,
        /// Number of episodes reported as failed.
        failed: i64,
        /// Number of episodes without a result when the lease ended.
        expired: i64,
        /// True if the group counted as evidence of mastery.
        evidence: bool,
    },
    /// The level of a task changed.
    Move(&'a LevelMove),
    /// A claim of results as columns was received or changed its state.
    Claim {
        /// Id of the lease.
        lease: String,
        /// State of the claim.
        state: ClaimState,
        /// Number of claimed episodes.
        episodes: i64,
        /// Number of claimed episodes that failed.
        failed: i64,
        /// Number of groups that are audited by replay.
        audited: i64,
        /// Reason of the refusal.
        #[serde(skip_serializing_if = "Option::is_none")]
        reason: Option<&'a str>,
    },
    /// Episodes of a task that were criticised.
    Failures {
        /// Id of the task.
        task: &'a str,
        /// Number of criticised episodes.
        criticised: usize,
        /// Number of episodes per failure mode.
        modes: std::collections::BTreeMap<&'a str, i64>,
    },
    /// A design request ended.
    Design {
        /// Id of the design request.
        request: String,
        /// Id of the task.
        task: &'a str,
        /// Designer that ran the request.
        designer: DesignerKind,
        /// Number of layouts that the gate admitted.
        admitted: i64,
        /// Number of layouts that the gate refused.
        refused: i64,
        /// Reason if the request failed.
        #[serde(skip_serializing_if = "Option::is_none")]
        error: Option<&'a str>,
    },
    /// A worker on another machine joined or left, or workers do jobs again.
    Worker {
        /// Text of the event, one sentence.
        message: &'a str,
    },
    /// A warning for the operator of the run.
    Warning {
        /// Id of the task that the warning concerns.
        #[serde(skip_serializing_if = "Option::is_none")]
        task: Option<&'a str>,
        /// Text of the warning, one sentence.
        message: &'a str,
    },
}

impl<'a> RunEvent<'a> {
    /// Returns the kind of the event.
    #[must_use]
    pub const fn kind(&self) -> EventKind {
        match self {
            Self::Run { .. } => EventKind::Run,
            Self::Lease { .. } => EventKind::Lease,
            Self::Group { .. } => EventKind::Group,
            Self::Move(_) => EventKind::Move,
            Self::Claim { .. } => EventKind::Claim,
            Self::Failures { .. } => EventKind::Failures,
            Self::Design { .. } => EventKind::Design,
            Self::Worker { .. } => EventKind::Worker,
            Self::Warning { .. } => EventKind::Warning,
        }
    }

    /// Builds the event of a lease that changed its state.
    #[must_use]
    pub fn lease(row: &LeaseRow, state: LeaseEvent) -> Self {
        let LeaseRow { purpose, form, groups, group_size, .. } = *row;
        Self::Lease { lease: row.name(), state, purpose, form, groups, group_size }
    }

    /// Builds the event of a group that closed; `expired` of its episodes had no result when the lease ended.
    #[must_use]
    pub fn group(lease: &LeaseRow, group: &'a GroupRow, expired: i64) -> Self {
        Self::Group {
            lease: lease.name(),
            group: group.number,
            task: &group.task,
            level: group.level,
            role: group.role,
            state: group.state,
            contested: group.is_contested,
            finished: group.finished,
            successes: group.successes,
            failed: group.failed,
            expired,
            evidence: group.is_mastery_evidence(),
        }
    }
}

impl Outbox {
    /// Emits a run event at this time. Listeners receive it after the commit.
    ///
    /// # Errors
    /// Returns [`ServiceError::Store`] if the event cannot be written as JSON.
    pub fn emit(&mut self, run: &str, event: &RunEvent<'_>, at: Millis) -> Result<(), ServiceError> {
        let body = to_json(event)?;
        match event {
            RunEvent::Lease { state, .. } => metrics::record_lease(*state),
            RunEvent::Move(moved) => {
                metrics::record_level_move(moved.task.clone(), move_kind(moved.kind).to_string());
            }
            _ => {}
        }
        self.push_event(NewEvent { run: run.to_owned(), kind: event.kind(), body, at });
        Ok(())
    }
}
