//! Pauses, resumes and archives runs.

use store::ids::RunId;
use store::leases;
use store::runs::{self, RunRow, RunStatus};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;

/// Change of a run's status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunAction {
    /// Resume the run, if it was paused or archived. Its leases get the time that they had left.
    Resume,
    /// Grant no leases; results of granted leases are still accepted, and their deadlines stand still.
    Pause,
    /// Pause the run and leave it out of lists.
    Archive,
}

/// Pauses, resumes or archives a run.
#[derive(Debug)]
pub struct SetRunStatus {
    /// Id of the run.
    pub run: RunId,
    /// Change of its status.
    pub action: RunAction,
}

impl Change for SetRunStatus {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        set_status(tx, self.run.as_str(), self.action).await
    }
}

/// Archives several runs: all of them or none.
#[derive(Debug)]
pub struct ArchiveRuns {
    /// Ids of the runs.
    pub runs: Vec<RunId>,
}

impl Change for ArchiveRuns {
    /// The runs in the order of the request.
    type Output = Vec<RunRow>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Vec<RunRow>, ServiceError> {
        let mut rows = Vec::with_capacity(self.runs.len());
        for (at, run) in self.runs.iter().enumerate() {
            let archived = set_status(tx, run.as_str(), RunAction::Archive).await;
            rows.push(archived.map_err(|error| match error {
                ServiceError::UnknownRun(run) => ServiceError::invalid(
                    format!("runs.{at}"),
                    format!("there is no run {run}; nothing was archived"),
                ),
                other => other,
            })?);
        }
        Ok(rows)
    }
}

async fn set_status(tx: &mut WriteTx, id: &str, action: RunAction) -> Result<RunRow, ServiceError> {
    let mut run = tx.run(id).await?;
    let paused_at = match (action, run.state.paused_at) {
        (RunAction::Resume, Some(paused_at)) => {
            leases::shift_deadlines(run.conn, id, run.now - paused_at).await?;
            run.state.forget_deadlines();
            None
        }
        (RunAction::Resume, None) => None,
        (RunAction::Pause | RunAction::Archive, paused_at) => paused_at.or(Some(run.now)),
    };
    run.state.paused_at = paused_at;
    let archived_at = runs::get(run.conn, id).await?.and_then(|row| row.archived_at);
    let (status, archived_at, event) = match action {
        RunAction::Resume => (RunStatus::Active, None, "resumed"),
        // An archived run is already paused, and stays archived.
        RunAction::Pause => (RunStatus::Paused, archived_at, "paused"),
        RunAction::Archive => (RunStatus::Paused, archived_at.or(Some(run.now)), "archived"),
    };
    runs::set_status(run.conn, id, status, archived_at, paused_at).await?;
    let row = runs::get(run.conn, id).await?.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))?;
    run.outbox.signal(Signal::Prepare);
    run.outbox.signal(Signal::Rollout);
    run.outbox.signal(Signal::RunStates);
    run.emit(&RunEvent::Run { state: event })?;
    Ok(row)
}
