//! Level and mastery of the runs in memory, for `/metrics`.

use crate::engine::change::{ReadTx, StateQuery};
use crate::engine::error::ServiceError;
use curriculum::Mastery;

/// Runs reported at most: each has time series of its own wherever metrics are stored.
const MAX_RUNS: usize = 100;

/// Level and mastery of one task of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct MasteryGauge {
    /// Id of the run.
    pub run: String,
    /// Id of the task.
    pub task: String,
    /// Level of the task; `None` during placement and for strategies without levels.
    pub level: Option<u32>,
    /// Mastery at the level; `None` before there is evidence.
    pub mastery: Option<Mastery>,
}

/// Asks for level and mastery of the runs in memory.
#[derive(Debug)]
pub struct MasteryGaugesQuery;

impl StateQuery for MasteryGaugesQuery {
    type Output = Vec<MasteryGauge>;

    async fn read(self, tx: &mut ReadTx<'_>) -> Result<Vec<MasteryGauge>, ServiceError> {
        let mut gauges = Vec::new();
        for state in tx.cached_runs().take(MAX_RUNS) {
            let mastery = state.curriculum.mastery();
            for status in state.curriculum.status() {
                let here = |known: &&Mastery| known.task == status.task && known.level == status.level;
                let mastery = mastery.iter().find(here).cloned();
                let level = status.level.filter(|_| status.placement_done);
                gauges.push(MasteryGauge { run: state.run.clone(), task: status.task, level, mastery });
            }
        }
        Ok(gauges)
    }
}
