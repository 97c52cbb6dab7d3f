//! Passes the outcome of a group to the curriculum.

use std::collections::BTreeSet;

use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_state::RunState;
use crate::engine::run_tx::RunTx;
use crate::leases::proposal_queue;
use curriculum::{GroupOutcome, LevelMove, Slot};

/// Passes an outcome to the curriculum, emits its moves and new warnings, and discards the proposals that a move made stale.
pub(crate) async fn observe(
    run: &mut RunTx<'_>,
    outcome: GroupOutcome,
) -> Result<Vec<LevelMove>, ServiceError> {
    let before = TaskMark::of(&run.state, &outcome.task);
    let moves = run.state.observe(run.conn, outcome, run.now).await?;
    for job in run.state.curriculum.take_background_jobs() {
        tokio::task::spawn_blocking(move || job.run());
    }
    after_event(run, vec![before], &moves).await?;
    Ok(moves)
}

/// Drops slots whose groups the server lost before a trainer saw them, with the same effects.
pub(crate) async fn withdraw(run: &mut RunTx<'_>, slots: Vec<Slot>) -> Result<Vec<LevelMove>, ServiceError> {
    let tasks: BTreeSet<&str> = slots.iter().map(|slot| slot.task.as_str()).collect();
    let before = tasks.into_iter().map(|task| TaskMark::of(&run.state, task)).collect();
    let moves = run.state.withdraw_slots(run.conn, slots, run.now).await?;
    after_event(run, before, &moves).await?;
    Ok(moves)
}

/// Epoch and number of warnings of a task before an event.
struct TaskMark {
    task: String,
    epoch: u32,
    warnings: usize,
}

impl TaskMark {
    fn of(state: &RunState, task: &str) -> Self {
        let (epoch, warnings) = (state.curriculum.epoch(task), state.curriculum.warnings(task).len());
        Self { task: task.to_owned(), epoch, warnings }
    }
}

/// Emits the moves and new warnings of an event, and discards the proposals that a move made stale.
async fn after_event(
    run: &mut RunTx<'_>,
    before: Vec<TaskMark>,
    moves: &[LevelMove],
) -> Result<(), ServiceError> {
    for level_move in moves {
        run.emit(&RunEvent::Move(level_move))?;
    }
    let mut has_new_epoch = false;
    for TaskMark { task, epoch, warnings } in before {
        // The texts of warnings contain counts and change, so that only a growing number of warnings is news.
        for message in run.state.curriculum.warnings(&task).get(warnings..).unwrap_or_default() {
            run.emit(&RunEvent::Warning { task: Some(&task), message })?;
        }
        has_new_epoch |= run.state.curriculum.epoch(&task) != epoch;
    }
    if has_new_epoch {
        proposal_queue::drop_stale(run).await?;
    }
    Ok(())
}
