//! Ending an evaluation that nobody will fly.

use crate::store::evaluations::{self, EvaluationRow, EvaluationState};
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;

/// What is told of one that was cancelled.
const TROUBLE: &str = "it was cancelled";

/// Ends an evaluation that is not complete; once more changes nothing.
#[derive(Debug)]
pub struct CancelEvaluation {
    /// Its number.
    pub id: i64,
}

impl Change for CancelEvaluation {
    type Output = EvaluationRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<EvaluationRow, ServiceError> {
        let Self { id } = self;
        let conn = &mut tx.conn;
        let unknown = || ServiceError::UnknownEvaluation(id);
        match evaluations::get(conn, id).await?.ok_or_else(unknown)? {
            row if row.state == EvaluationState::Complete => Err(ServiceError::EvaluationOver(id)),
            row if row.state == EvaluationState::Failed => Ok(row),
            _ => {
                evaluations::fail(conn, id, TROUBLE).await?;
                evaluations::get(conn, id).await?.ok_or_else(unknown)
            }
        }
    }
}
