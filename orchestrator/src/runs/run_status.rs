//! What people set of a run that goes on: whether it is paused, which policy version is the newest, what it keeps.

use crate::runs::settings::RetentionRequest;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::signals::Signal;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use crate::ids::RunId;
use crate::store::runs::{self, RunRow, RunStatus};
use crate::store::to_json;

/// What a run should do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunAction {
    /// Go on, if it was paused or archived.
    Resume,
    /// Grant no leases; results of leases it has granted are still taken.
    Pause,
    /// The same, and be left out of lists.
    Archive,
}

/// Pauses, resumes or archives a run.
#[derive(Debug)]
pub struct SetRunStatus {
    /// Which.
    pub run: RunId,
    /// What it should do.
    pub course: RunAction,
}

impl Change for SetRunStatus {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let (run, now) = (self.run.as_str(), tx.now);
        let RunTx { state: mind, conn, .. } = tx.run(run).await?;
        mind.is_paused = self.course != RunAction::Resume;
        let before = runs::get(conn, run).await?.and_then(|row| row.archived_at);
        let (status, archived_at, state) = match self.course {
            RunAction::Resume => (RunStatus::Active, None, "resumed"),
            // What is archived stays so: it is paused already.
            RunAction::Pause => (RunStatus::Paused, before, "paused"),
            RunAction::Archive => (RunStatus::Paused, before.or(Some(now)), "archived"),
        };
        runs::set_status(conn, run, status, archived_at).await?;
        let row = runs::get(conn, run).await?.ok_or_else(|| ServiceError::UnknownRun(run.to_owned()))?;
        tx.outbox.signal(Signal::Prepare);
        tx.outbox.signal(Signal::Rollout);
        tx.emit(run, &RunEvent::Run { state })?;
        Ok(row)
    }
}

/// Says which policy version is the newest: what trainers report raises it by itself, and a wrong one stays until it is set.
#[derive(Debug)]
pub struct SetPolicyVersion {
    /// Of which run.
    pub run: RunId,
    /// The version.
    pub policy_version: u32,
}

impl Change for SetPolicyVersion {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let run = self.run.as_str();
        let RunTx { state: mind, conn, .. } = tx.run(run).await?;
        mind.policy_version = i64::from(self.policy_version);
        runs::set_policy_version(conn, run, mind.policy_version).await?;
        runs::get(conn, run).await?.ok_or_else(|| ServiceError::UnknownRun(run.to_owned()))
    }
}

/// Says what the run keeps whole.
#[derive(Debug)]
pub struct SetRetention {
    /// Of which run.
    pub run: RunId,
    /// What is to change of it.
    pub wish: RetentionRequest,
}

impl Change for SetRetention {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let (run, now) = (self.run.as_str(), tx.now);
        let RunTx { state: mind, conn, .. } = tx.run(run).await?;
        mind.settings.retention = mind.settings.retention.with(self.wish);
        runs::set_settings(conn, run, &to_json(&mind.settings)?, now).await?;
        runs::get(conn, run).await?.ok_or_else(|| ServiceError::UnknownRun(run.to_owned()))
    }
}
