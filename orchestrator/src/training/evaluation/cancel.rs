//! Ending an evaluation that nobody will fly.

use crate::store::evaluations::{self, EvaluationRow};
use crate::training::{Change, TrainingError, Work};

/// What is told of one that was cancelled.
const TROUBLE: &str = "it was cancelled";

/// Ends an evaluation that is not complete; once more changes nothing.
#[derive(Debug)]
pub struct CancelEvaluation {
    /// Its number.
    pub id: i64,
}

impl Change for CancelEvaluation {
    type Answer = EvaluationRow;

    async fn apply(self, work: &mut Work) -> Result<EvaluationRow, TrainingError> {
        let Self { id } = self;
        let conn = &mut work.conn;
        let unknown = || TrainingError::UnknownEvaluation(id);
        match evaluations::get(conn, id).await?.ok_or_else(unknown)? {
            row if row.state == "complete" => Err(TrainingError::EvaluationOver(id)),
            row if row.state == "failed" => Ok(row),
            _ => {
                evaluations::fail(conn, id, TROUBLE).await?;
                evaluations::get(conn, id).await?.ok_or_else(unknown)
            }
        }
    }
}
