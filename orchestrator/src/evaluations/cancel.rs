//! Cancels evaluations that are not complete.

use store::evaluations::{self, EvaluationRow, EvaluationState};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Reason that is stored with a cancelled evaluation.
const CANCELLED: &str = "it was cancelled";

/// Cancels an evaluation. Repeating it has no effect.
#[derive(Debug)]
pub struct CancelEvaluation {
    /// Number of the evaluation.
    pub id: i64,
}

impl Change for CancelEvaluation {
    type Output = EvaluationRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<EvaluationRow, ServiceError> {
        let Self { id } = self;
        let conn = &mut tx.conn;
        let unknown = || ServiceError::UnknownEvaluation(id);
        match evaluations::get(conn, id).await?.ok_or_else(unknown)? {
            row if row.state == EvaluationState::Complete => Err(ServiceError::EvaluationEnded(id)),
            row if row.state == EvaluationState::Failed => Ok(row),
            _ => {
                evaluations::fail(conn, id, CANCELLED).await?;
                evaluations::get(conn, id).await?.ok_or_else(unknown)
            }
        }
    }
}
