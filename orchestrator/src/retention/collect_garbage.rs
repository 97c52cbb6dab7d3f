//! Deletes proposals, scenarios and curriculum events that nothing refers to.

use store::{gc, to_i64};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Maximum number of proposals, and of events, that one change deletes.
const MAX_DELETED: i64 = 500;

/// Deletes old proposals that no stored episode derives from, with the scenarios that only they refer to, and curriculum events
/// behind the run's snapshots.
#[derive(Debug)]
pub struct CollectGarbage {
    /// Id of the run.
    pub run: String,
    /// Sequence number before which nothing is needed.
    pub before: i64,
}

impl Change for CollectGarbage {
    /// True if more rows may be left.
    type Output = bool;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<bool, ServiceError> {
        let run = tx.run(&self.run).await?;
        // The curriculum may propose the scenarios of retained proposals again.
        let retained: Vec<i64> = run.state.curriculum.retained_proposals().into_iter().map(to_i64).collect();
        let deleted = gc::delete_proposals(run.conn, &self.run, self.before, &retained, MAX_DELETED).await?;
        let may_have_more = deleted.len() as i64 == MAX_DELETED;
        let scenarios: Vec<Vec<u8>> = deleted.into_iter().flatten().collect();
        gc::delete_scenarios(run.conn, &scenarios).await?;
        let events = gc::delete_events(run.conn, &self.run, self.before, MAX_DELETED).await?;
        Ok(may_have_more || events as i64 == MAX_DELETED)
    }
}
