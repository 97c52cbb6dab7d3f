//! Current level and mastery of a run's tasks, in the form that their history has.

use std::collections::BTreeMap;

use crate::engine::change::{Query, ReadTx};
use crate::engine::error::ServiceError;
use crate::engine::task_history::current_standings;
use crate::ids::RunId;
use crate::store::history::{HistoryPoint, MasterySample};

/// Asks for the current level and mastery of each task of a run.
#[derive(Debug)]
pub struct CurrentStanding {
    /// Id of the run.
    pub run: RunId,
}

impl Query for CurrentStanding {
    type Output = BTreeMap<String, MasterySample>;

    async fn read(self, tx: &mut ReadTx<'_>) -> Result<Self::Output, ServiceError> {
        let (state, _) = tx.run(self.run.as_str()).await?;
        Ok(current_standings(state))
    }
}

/// Sets the standing of each task's last point to the current one: the stored sample may be some seconds older than the last results.
pub fn update_last_points(points: &mut [HistoryPoint], current: &BTreeMap<String, MasterySample>) {
    for at in 0..points.len() {
        let is_last = points.get(at + 1).is_none_or(|next| next.task != points[at].task);
        if let Some(standing) = current.get(&points[at].task).filter(|_| is_last) {
            points[at].bucket.mastery = Some(*standing);
        }
    }
}
