//! What people set of a run that goes on: whether it is paused, which policy version is the newest, what it keeps.

use super::settings::RetentionWish;
use super::{Change, Happening, TrainingError, Work};
use crate::ids::RunId;
use crate::store::runs::{self, RunRow};
use crate::store::to_json;

/// What a run should do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Course {
    /// Go on, if it was paused or archived.
    Resume,
    /// Grant no leases; results of leases it has granted are still taken.
    Pause,
    /// The same, and be left out of lists.
    Archive,
}

/// Pauses, resumes or archives a run.
#[derive(Debug)]
pub struct SetCourse {
    /// Which.
    pub run: RunId,
    /// What it should do.
    pub course: Course,
}

impl Change for SetCourse {
    type Answer = RunRow;

    async fn apply(self, work: &mut Work) -> Result<RunRow, TrainingError> {
        let (run, now) = (self.run.as_str(), work.now);
        let (mind, conn) = work.mind(run).await?;
        mind.paused = self.course != Course::Resume;
        let before = runs::get(conn, run).await?.and_then(|row| row.archived_at);
        let (status, archived_at, state) = match self.course {
            Course::Resume => ("active", None, "resumed"),
            // What is archived stays so: it is paused already.
            Course::Pause => ("paused", before, "paused"),
            Course::Archive => ("paused", before.or(Some(now)), "archived"),
        };
        runs::set_status(conn, run, status, archived_at).await?;
        let row = runs::get(conn, run).await?.ok_or_else(|| TrainingError::UnknownRun(run.to_owned()))?;
        work.wake_prepare();
        work.wake_rollout();
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
        let (run, now) = (self.run.as_str(), work.now);
        let (mind, conn) = work.mind(run).await?;
        mind.settings.retention = mind.settings.retention.with(self.wish);
        runs::set_settings(conn, run, &to_json(&mind.settings)?, now).await?;
        runs::get(conn, run).await?.ok_or_else(|| TrainingError::UnknownRun(run.to_owned()))
    }
}
