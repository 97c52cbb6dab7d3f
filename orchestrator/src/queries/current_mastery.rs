//! Current level and mastery of a run's tasks, in the form that their history has.

use std::collections::BTreeMap;

use store::history::MasterySample;
use store::ids::RunId;

use crate::engine::change::{ReadTx, StateQuery};
use crate::engine::error::ServiceError;
use crate::engine::task_history::current_mastery_samples;

/// Query for the current level and mastery of each task of a run.
#[derive(Debug)]
pub struct CurrentMastery {
    /// Id of the run.
    pub run: RunId,
}

impl StateQuery for CurrentMastery {
    type Output = BTreeMap<String, MasterySample>;

    async fn read(self, tx: &mut ReadTx<'_>) -> Result<Self::Output, ServiceError> {
        let (state, _) = tx.run(self.run.as_str()).await?;
        Ok(current_mastery_samples(state))
    }
}
