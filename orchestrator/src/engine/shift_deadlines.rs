//! Shifts stored deadlines after the system clock jumped.

use store::deadlines;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use clock::Clock;

/// Shifts every stored deadline by the jump of the system clock, and makes the service's clock follow the system clock again.
#[derive(Debug)]
pub struct ShiftDeadlines(pub Clock);

impl Change for ShiftDeadlines {
    /// The shift in milliseconds; `None` if the clock has not jumped, or has jumped back.
    type Output = Option<i64>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Option<i64>, ServiceError> {
        let Some(jump) = self.0.jumped() else { return Ok(None) };
        deadlines::shift(&mut tx.conn, jump).await?;
        tx.runs.shift_times(jump);
        // Changes of the same transaction see the new time. If the commit fails the writer sets the clock back.
        self.0.adopt(jump);
        tx.clock_shift += jump;
        Ok(Some(jump))
    }
}
