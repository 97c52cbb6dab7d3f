//! Deletes the rows of runs that were marked as deleted.

use store::run_deletion;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Deletes a few hundred rows of the run that was marked first. The next change waits a few milliseconds only.
#[derive(Debug)]
pub struct DeleteRunRows;

/// Result of one deletion of rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RowDeletion {
    /// No run is marked.
    Nothing,
    /// Rows of the run are left.
    Unfinished,
    /// Nothing is left of the run with this id.
    Finished(String),
}

impl Change for DeleteRunRows {
    type Output = RowDeletion;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<RowDeletion, ServiceError> {
        let Some(run) = run_deletion::oldest_pending(&mut tx.conn).await? else {
            return Ok(RowDeletion::Nothing);
        };
        let has_more = run_deletion::delete_rows(&mut tx.conn, &run).await?;
        Ok(if has_more { RowDeletion::Unfinished } else { RowDeletion::Finished(run) })
    }
}
