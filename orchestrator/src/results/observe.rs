//! Passes the outcome of a group to the curriculum.

use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_state::RunState;
use crate::engine::run_tx::RunTx;
use crate::leases::proposal_queue;
use curriculum::{GroupOutcome, LevelMove, Slot, TaskPlan};

/// Passes an outcome to the curriculum, emits its moves and new warnings, and discards the proposals that a move made stale.
pub(crate) async fn observe(
    run: &mut RunTx<'_>,
    outcome: GroupOutcome,
) -> Result<Vec<LevelMove>, ServiceError> {
    let before = TaskMark::of_run(run.state);
    let moves = run.state.observe(run.conn, outcome, run.now).await?;
    for job in run.state.curriculum.take_background_jobs() {
        tokio::task::spawn_blocking(move || job.run());
    }
    after_event(run, &before, &moves).await?;
    Ok(moves)
}

/// Drops slots whose groups the server lost before a trainer saw them, with the same effects.
pub(crate) async fn withdraw(run: &mut RunTx<'_>, slots: Vec<Slot>) -> Result<Vec<LevelMove>, ServiceError> {
    let before = TaskMark::of_run(run.state);
    let moves = run.state.withdraw_slots(run.conn, slots, run.now).await?;
    after_event(run, &before, &moves).await?;
    Ok(moves)
}

/// Epoch and number of warnings of a task.
struct TaskMark {
    epoch: u32,
    warnings: usize,
}

impl TaskMark {
    /// Marks of the tasks of a run, in the order of its settings.
    fn of_run(state: &RunState) -> Vec<Self> {
        let mark = |plan: &TaskPlan| Self {
            epoch: state.curriculum.epoch(&plan.task),
            warnings: state.curriculum.warnings(&plan.task).len(),
        };
        state.settings.curriculum.tasks.iter().map(mark).collect()
    }
}

/// Emits the moves and new warnings of an event, and discards the proposals that a move made stale.
async fn after_event(
    run: &mut RunTx<'_>,
    before: &[TaskMark],
    moves: &[LevelMove],
) -> Result<(), ServiceError> {
    for level_move in moves {
        run.emit(&RunEvent::Move(level_move))?;
    }
    let mut has_new_epoch = false;
    let tasks: Vec<String> =
        run.state.settings.curriculum.tasks.iter().map(|plan| plan.task.clone()).collect();
    for (task, before) in tasks.iter().zip(before) {
        // The texts of warnings contain counts and change, so that only a growing number of warnings is news.
        for message in run.state.curriculum.warnings(task).iter().skip(before.warnings) {
            run.emit(&RunEvent::Warning { task: Some(task), message })?;
        }
        has_new_epoch |= run.state.curriculum.epoch(task) != before.epoch;
    }
    if has_new_epoch {
        proposal_queue::drop_stale(run).await?;
    }
    Ok(())
}
