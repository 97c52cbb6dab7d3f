//! What people set of a run that goes on: whether it is paused, which policy version is the newest, what it keeps.

use super::settings::RetentionWish;
use super::{Change, Happening, TrainingError, Work};
use crate::ids::RunId;
use crate::store::runs::{self, RunRow};
use crate::store::to_json;

/// Pauses or resumes a run. A paused run grants no leases; results of leases it has granted are still taken.
#[derive(Debug)]
pub struct SetPaused {
    /// Which.
    pub run: RunId,
    /// Whether it should be paused.
    pub paused: bool,
}

impl Change for SetPaused {
    type Answer = RunRow;

    async fn apply(self, work: &mut Work) -> Result<RunRow, TrainingError> {
        let run = self.run.as_str();
        let (mind, conn) = work.mind(run).await?;
        mind.paused = self.paused;
        runs::set_status(conn, run, if self.paused { "paused" } else { "active" }).await?;
        let row = runs::get(conn, run).await?.ok_or_else(|| TrainingError::UnknownRun(run.to_owned()))?;
        work.wake_prepare();
        work.wake_rollout();
        let state = if self.paused { "paused" } else { "resumed" };
        work.tell(run, &Happening::Run { state })?;
        Ok(row)
    }
}

/// Says which policy version is the newest: what trainers report raises it by itself, and a wrong one stays until it is set.
#[derive(Debug)]
pub struct SetNewest {
    /// Of which run.
    pub run: RunId,
    /// The version.
    pub policy_version: u32,
}

impl Change for SetNewest {
    type Answer = RunRow;

    async fn apply(self, work: &mut Work) -> Result<RunRow, TrainingError> {
        let run = self.run.as_str();
        let (mind, conn) = work.mind(run).await?;
        mind.policy_version = i64::from(self.policy_version);
        runs::set_policy_version(conn, run, mind.policy_version).await?;
        runs::get(conn, run).await?.ok_or_else(|| TrainingError::UnknownRun(run.to_owned()))
    }
}

/// Says what the run keeps whole.
#[derive(Debug)]
pub struct SetRetention {
    /// Of which run.
    pub run: RunId,
    /// What is to change of it.
    pub wish: RetentionWish,
}

impl Change for SetRetention {
    type Answer = RunRow;

    async fn apply(self, work: &mut Work) -> Result<RunRow, TrainingError> {
        let run = self.run.as_str();
        let (mind, conn) = work.mind(run).await?;
        mind.settings.retention = mind.settings.retention.with(self.wish);
        runs::set_settings(conn, run, &to_json(&mind.settings)?).await?;
        runs::get(conn, run).await?.ok_or_else(|| TrainingError::UnknownRun(run.to_owned()))
    }
}
