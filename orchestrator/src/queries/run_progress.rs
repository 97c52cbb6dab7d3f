//! Progress of a run at one moment: settings, levels, mastery and counters of every task.

use std::collections::BTreeMap;

use sqlx::SqliteConnection;
use store::columns::{self, ClaimCounters};
use store::group_counters::{self, GroupCounters};
use store::ids::RunId;
use store::task_counters::{self, TaskCounters};

use crate::engine::change::{ReadTx, StateQuery};
use crate::engine::error::ServiceError;
use crate::engine::run_state::RunState;
use crate::runs::settings::RunSettings;
use curriculum::{Explanation, Mastery, SamplerState, TaskStatus};

/// Asks for the progress of a run.
#[derive(Debug)]
pub struct RunProgressQuery {
    /// Id of the run.
    pub run: RunId,
}

/// Progress of a run, all of one moment.
#[derive(Debug)]
pub struct RunProgress {
    /// Current settings of the run.
    pub settings: RunSettings,
    /// Status of each task.
    pub status: Vec<TaskStatus>,
    /// Mastery per task and level.
    pub mastery: Vec<Mastery>,
    /// The rules of the strategy and its last moves, as text.
    pub explanation: Explanation,
    /// Sampler of each task.
    pub samplers: Vec<SamplerState>,
    /// Episode counters per task, without designed groups.
    pub sums: BTreeMap<String, TaskCounters>,
    /// Episode counters of designed groups per task.
    pub designed: BTreeMap<String, TaskCounters>,
    /// Counters of episodes claimed as columns, per task.
    pub claimed: BTreeMap<String, ClaimCounters>,
    /// Outcomes of groups of several episodes, per task and level.
    pub groups: Vec<GroupCounters>,
    /// Number of curriculum events so far.
    pub next_seq: u64,
}

impl StateQuery for RunProgressQuery {
    type Output = RunProgress;

    async fn read(self, tx: &mut ReadTx<'_>) -> Result<RunProgress, ServiceError> {
        let (state, conn) = tx.run(self.run.as_str()).await?;
        RunProgress::of(state, conn, self.run.as_str()).await
    }
}

impl RunProgress {
    /// Reads the progress of a stored run, for callers without a writer.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`] if the run does not exist, and another error if it cannot be restored.
    pub async fn stored(conn: &mut SqliteConnection, run: &str) -> Result<Self, ServiceError> {
        let state = RunState::load(conn, run).await?;
        Self::of(&state, conn, run).await
    }

    async fn of(state: &RunState, conn: &mut SqliteConnection, run: &str) -> Result<Self, ServiceError> {
        Ok(Self {
            settings: state.settings.clone(),
            status: state.curriculum.status(),
            mastery: state.curriculum.mastery(),
            explanation: state.curriculum.explain(),
            samplers: state.curriculum.samplers(),
            sums: task_counters::of_run(conn, run, false).await?,
            designed: task_counters::of_run(conn, run, true).await?,
            claimed: columns::counters(conn, run).await?,
            groups: group_counters::of_run(conn, run).await?,
            next_seq: state.curriculum.next_seq(),
        })
    }
}
