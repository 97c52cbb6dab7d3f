//! Deletes minute buckets of a run's history that are old enough to be kept by the hour only.

use store::history;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Rows deleted by one change at most.
const MAX_ROWS: i64 = 500;

/// Deletes up to 500 old minute buckets of a run.
#[derive(Debug)]
pub struct DeleteOldMinutes {
    /// Id of the run.
    pub run: String,
}

impl Change for DeleteOldMinutes {
    /// True if more rows may be left.
    type Output = bool;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<bool, ServiceError> {
        let now = tx.now;
        Ok(history::delete_old_minutes(&mut tx.conn, &self.run, now, MAX_ROWS).await?)
    }
}
