//! Deletes an archived run. Its rows are deleted later, in small changes ([`crate::retention::delete_run_rows`]).

use clock::Millis;
use store::audit_log::{self, AuditRing, AuditRow};
use store::ids::RunId;
use store::run_deletion;
use store::runs::{self, RunRow};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;

/// Marks an archived run as deleted. From the commit on, no request and no worker finds the run.
#[derive(Debug)]
pub struct DeleteRun {
    /// Id of the run.
    pub run: RunId,
    /// Name of the run, which confirms the deletion.
    pub name: String,
}

impl Change for DeleteRun {
    /// The run before the deletion.
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let Self { run, name } = self;
        let id = run.as_str();
        let row = runs::get(&mut tx.conn, id).await?;
        let row = row.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))?;
        if row.archived_at.is_none() {
            return Err(ServiceError::RunNotArchived(row.id));
        }
        if row.name != name {
            return Err(ServiceError::RunNameMismatch { run: row.id, name });
        }
        mark_deleted(tx, id).await?;
        Ok(row)
    }
}

/// Marks a run as deleted if it was archived before a time and still is.
#[derive(Debug)]
pub struct DeleteOverdueRun {
    /// Id of the run.
    pub run: String,
    /// Time before which the run must have been archived.
    pub archived_before: Millis,
}

impl Change for DeleteOverdueRun {
    /// True if the run was deleted.
    type Output = bool;

    async fn apply(self, tx: &mut WriteTx) -> Result<bool, ServiceError> {
        let row = runs::get(&mut tx.conn, &self.run).await?;
        // The run may have been resumed since it was found.
        let is_overdue = row.and_then(|row| row.archived_at).is_some_and(|at| at < self.archived_before);
        if is_overdue {
            mark_deleted(tx, &self.run).await?;
            let line = AuditRow {
                id: 0,
                at: tx.now,
                token: None,
                name: None,
                address: None,
                operation: "server: delete old archived run".to_owned(),
                path: format!("/v1/runs/{}", self.run),
                status: 200,
                request_id: String::new(),
            };
            audit_log::append(&mut tx.conn, AuditRing::Changes, &line).await?;
        }
        Ok(is_overdue)
    }
}

/// Marks a run as deleted.
async fn mark_deleted(tx: &mut WriteTx, id: &str) -> Result<(), ServiceError> {
    run_deletion::mark(&mut tx.conn, id, tx.now).await?;
    tx.runs.evict(id);
    tx.outbox.forget_run(id);
    // Listeners and long polls find that the run is gone.
    tx.outbox.signal(Signal::Events);
    tx.outbox.signal(Signal::Feed);
    tx.outbox.signal(Signal::Delete);
    tx.outbox.signal(Signal::RunStates);
    Ok(())
}
