//! Cancels evaluations that are not complete.

use sqlx::SqliteConnection;
use store::StoreError;
use store::evaluations::{self, EvaluationRow, EvaluationState};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::ownership::{Actor, RunPermission, check_run};

/// Reason that is stored with a cancelled evaluation.
const CANCELLED: &str = "it was cancelled";

/// Cancels an evaluation of the actor, or of a run that it owns. Repeating it has no effect.
#[derive(Debug)]
pub struct CancelEvaluation {
    /// Number of the evaluation.
    pub id: i64,
    /// Client that cancels it.
    pub actor: Actor,
}

impl Change for CancelEvaluation {
    type Output = EvaluationRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<EvaluationRow, ServiceError> {
        let Self { id, actor } = self;
        let conn = &mut tx.conn;
        let unknown = || ServiceError::UnknownEvaluation(id);
        let row = evaluations::get(conn, id).await?.ok_or_else(unknown)?;
        check_evaluation(conn, actor, &row).await?;
        match row {
            row if row.state == EvaluationState::Complete => Err(ServiceError::EvaluationEnded(id)),
            row if row.state == EvaluationState::Failed => Ok(row),
            _ => {
                evaluations::fail(conn, id, CANCELLED).await?;
                evaluations::get(conn, id).await?.ok_or_else(unknown)
            }
        }
    }
}

/// Checks that an actor may cancel an evaluation: the owner of its run, or of the evaluation if it has no run.
async fn check_evaluation(
    conn: &mut SqliteConnection,
    actor: Actor,
    evaluation: &EvaluationRow,
) -> Result<(), ServiceError> {
    match &evaluation.run {
        Some(run) => {
            let run = run.parse().map_err(|error| StoreError::corrupt("an evaluation", error))?;
            check_run(conn, actor, &run, RunPermission::Change).await
        }
        None if actor.owns(evaluation.owner) => Ok(()),
        None => Err(ServiceError::ForeignEvaluation(evaluation.id)),
    }
}
