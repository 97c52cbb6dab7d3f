//! Deletes an archived run. Its rows are deleted later, in small changes ([`crate::retention::delete_run_rows`]).

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
        let (id, now) = (run.as_str(), tx.now);
        let row = runs::get(&mut tx.conn, id).await?;
        let row = row.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))?;
        if row.archived_at.is_none() {
            return Err(ServiceError::RunNotArchived(row.id));
        }
        if row.name != name {
            return Err(ServiceError::RunNameMismatch { run: row.id, name });
        }
        run_deletion::mark(&mut tx.conn, id, now).await?;
        tx.runs.evict(id);
        tx.outbox.forget_run(id);
        // Listeners and long polls find that the run is gone.
        tx.outbox.signal(Signal::Events);
        tx.outbox.signal(Signal::Feed);
        tx.outbox.signal(Signal::Delete);
        Ok(row)
    }
}
