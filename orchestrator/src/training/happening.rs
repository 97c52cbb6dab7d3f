//! What listeners of a run are told, in the order it was committed.

use serde::Serialize;

use super::mind::word;
use super::{TrainingError, Work};
use crate::counts;
use crate::store::events::{self, Told};
use crate::store::groups::GroupRow;
use crate::store::leases::LeaseRow;
use crate::store::{StoreError, to_json};
use curriculum::Move;

/// Something that happened in a run.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Happening<'a> {
    /// The run was created, changed, paused, resumed or archived.
    Run {
        /// `created`, `changed` (told otherwise), `paused`, `resumed` or `archived`.
        state: &'a str,
    },
    /// A lease began, or came to something.
    Lease {
        /// Its id.
        lease: String,
        /// `taken`, `renewed`, `done`, `released` or `expired`.
        state: &'a str,
        /// What it is for.
        purpose: &'a str,
        /// `groups` or `columns`.
        form: &'a str,
        /// How many groups.
        groups: i64,
        /// Episodes in each.
        group_size: i64,
    },
    /// A group ended.
    Group {
        /// Its lease.
        lease: String,
        /// Its number there.
        group: i64,
        /// The task.
        task: &'a str,
        /// The level.
        level: Option<i64>,
        /// Its role.
        role: &'a str,
        /// `complete`, `partial` or `lost`.
        state: &'a str,
        /// Whether acting well mattered.
        contested: bool,
        /// Episodes that finished.
        finished: i64,
        /// Of these, successes.
        successes: i64,
        /// Episodes that failed.
        failed: i64,
        /// Episodes that never came back.
        expired: i64,
        /// Whether it could move the curriculum.
        evidence: bool,
    },
    /// A level moved.
    Move(&'a Move),
    /// What was claimed in columns came in, or came to something.
    Claim {
        /// The lease.
        lease: String,
        /// `claimed`, `accepted`, `refused` or `unproven`.
        state: &'a str,
        /// Episodes.
        episodes: i64,
        /// Of these, failed.
        failed: i64,
        /// Groups that are audited.
        audited: i64,
        /// Why it was refused.
        #[serde(skip_serializing_if = "Option::is_none")]
        why: Option<&'a str>,
    },
    /// Episodes were criticised.
    Failures {
        /// The task.
        task: &'a str,
        /// How many.
        criticised: usize,
        /// How often each failure mode was met.
        modes: std::collections::BTreeMap<&'a str, i64>,
    },
    /// A designer was asked, and what came of it.
    Design {
        /// The ask.
        ask: String,
        /// The task.
        task: &'a str,
        /// Who was asked.
        designer: &'a str,
        /// Layouts that the gate let through.
        admitted: i64,
        /// Layouts that it refused.
        refused: i64,
        /// Why the ask failed.
        #[serde(skip_serializing_if = "Option::is_none")]
        error: Option<&'a str>,
    },
    /// Something that whoever watches should know.
    Health {
        /// The task it is about.
        #[serde(skip_serializing_if = "Option::is_none")]
        task: Option<&'a str>,
        /// A sentence.
        words: &'a str,
    },
}

impl<'a> Happening<'a> {
    /// The word for its kind.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Run { .. } => "run",
            Self::Lease { .. } => "lease",
            Self::Group { .. } => "group",
            Self::Move(_) => "move",
            Self::Claim { .. } => "claim",
            Self::Failures { .. } => "failures",
            Self::Design { .. } => "design",
            Self::Health { .. } => "health",
        }
    }

    /// What became of a lease.
    #[must_use]
    pub fn lease(row: &'a LeaseRow, state: &'a str) -> Self {
        let LeaseRow { purpose, form, groups, group_size, .. } = row;
        Self::Lease { lease: row.name(), state, purpose, form, groups: *groups, group_size: *group_size }
    }

    /// How a group ended.
    #[must_use]
    pub fn group(lease: &LeaseRow, group: &'a GroupRow, expired: i64) -> Self {
        Self::Group {
            lease: lease.name(),
            group: group.number,
            task: &group.task,
            level: group.level,
            role: &group.role,
            state: &group.state,
            contested: group.contested != 0,
            finished: group.finished,
            successes: group.successes,
            failed: group.failed,
            expired,
            evidence: group.evidence != 0,
        }
    }
}

/// Events of a run between two looks at its ring.
pub(super) const TRIM_EVERY: u32 = 1_000;

impl Work {
    /// Tells the listeners of a run, once what it is about is committed.
    ///
    /// # Errors
    /// What happened cannot be written as JSON.
    pub fn tell(&mut self, run: &str, happening: &Happening<'_>) -> Result<(), TrainingError> {
        let body = to_json(happening)?;
        match happening {
            Happening::Lease { state, .. } => counts::lease(state),
            Happening::Move(moved) => counts::level_move(moved.task.clone(), word(&moved.kind)?),
            _ => {}
        }
        self.telling.push((run.to_owned(), happening.kind(), body, self.now));
        Ok(())
    }

    /// Writes what was told, and forgets what is past the rings.
    pub(super) async fn write_told(&mut self, told: &[Told]) -> Result<(), StoreError> {
        if told.is_empty() {
            return Ok(());
        }
        events::append(&mut self.conn, told).await?;
        for (run, ..) in told {
            if self.told(run) >= TRIM_EVERY {
                events::trim(&mut self.conn, run).await?;
                self.trimmed(run);
            }
        }
        Ok(())
    }
}
