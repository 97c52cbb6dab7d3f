//! Levels of a run's tasks, for the overview of many runs.

use store::ids::RunId;

use crate::engine::change::{ReadTx, StateQuery};
use crate::engine::error::ServiceError;
use curriculum::{Mastery, TaskStatus};

/// Asks for the level of each task of a run, and for its mastery there.
#[derive(Debug)]
pub struct TaskLevelsQuery {
    /// Id of the run.
    pub run: RunId,
}

/// Level of a task, and mastery at that level.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskLevel {
    /// Id of the task.
    pub task: String,
    /// Level of the task; `None` during placement and for strategies without levels.
    pub level: Option<u32>,
    /// Mastery at the level; `None` before there is evidence.
    pub mastery: Option<Mastery>,
    /// Reason why missing results hold the level back; `None` if they do not.
    pub held_back: Option<String>,
}

impl StateQuery for TaskLevelsQuery {
    type Output = Vec<TaskLevel>;

    async fn read(self, tx: &mut ReadTx<'_>) -> Result<Vec<TaskLevel>, ServiceError> {
        let (state, _) = tx.run(self.run.as_str()).await?;
        let mut mastery = state.curriculum.mastery();
        mastery.retain(|known| known.n > 0);
        let level_of = |status: TaskStatus| {
            let here = mastery.iter().find(|known| known.task == status.task && known.level == status.level);
            let level = status.level.filter(|_| status.placement_done);
            TaskLevel { level, mastery: here.cloned(), held_back: status.held_back, task: status.task }
        };
        Ok(state.curriculum.status().into_iter().map(level_of).collect())
    }
}
