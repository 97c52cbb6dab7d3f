//! Keeping what a judge said.

use store::runs;
use store::step_verdicts::{self, StepVerdictRow};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Keeps a model's verdict on a step.
#[derive(Debug)]
pub struct StoreVerdict(pub StepVerdictRow);

impl Change for StoreVerdict {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        if let Some(run) = &self.0.run
            && !runs::exists(&mut tx.conn, run).await?
        {
            return Ok(()); // it was deleted while the judge worked
        }
        Ok(step_verdicts::insert(&mut tx.conn, &self.0, tx.now).await?)
    }
}
