//! The clock of the day jumped: what waits for a time is moved with it.

use super::{Change, TrainingError, Work};
use crate::clock::Clock;
use crate::store::times;

/// Moves what waits for a time, and goes by the clock of the day again.
#[derive(Debug)]
pub struct Adopt(pub Clock);

impl Change for Adopt {
    /// By how much; none where it has not jumped, or no more.
    type Answer = Option<i64>;

    async fn apply(self, work: &mut Work) -> Result<Option<i64>, TrainingError> {
        let Some(jumped) = self.0.jumped() else { return Ok(None) };
        times::shift(&mut work.conn, jumped).await?;
        // What is committed with this is to see the new time; where the commit fails the writer lets the clock jump back.
        self.0.adopt(jumped);
        work.adopted += jumped;
        Ok(Some(jumped))
    }
}
