//! Current level and mastery of a run's tasks, in the form that their history has.

use std::collections::BTreeMap;

use store::history::{HistoryPoint, MasterySample};
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

/// Replaces the mastery of each task's last point by the current one: the stored sample may be some seconds older than the last results.
pub fn update_last_points(points: &mut [HistoryPoint], current: &BTreeMap<String, MasterySample>) {
    for at in 0..points.len() {
        let is_last = points.get(at + 1).is_none_or(|next| next.task != points[at].task);
        if let Some(sample) = current.get(&points[at].task).filter(|_| is_last) {
            points[at].bucket.mastery = Some(*sample);
        }
    }
}
