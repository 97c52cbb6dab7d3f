//! Passes the outcome of a group to the curriculum.

use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_tx::RunTx;
use crate::leases::proposal_queue;
use curriculum::{GroupOutcome, LevelMove};

/// Passes an outcome to the curriculum, emits its moves and new warnings, and discards the proposals that a move made stale.
pub(crate) async fn observe(
    run: &mut RunTx<'_>,
    outcome: GroupOutcome,
) -> Result<Vec<LevelMove>, ServiceError> {
    let before = run.state.curriculum.status();
    let moves = run.state.observe(run.conn, outcome, run.now).await?;
    for job in run.state.curriculum.take_background_jobs() {
        tokio::task::spawn_blocking(move || job.run());
    }
    let after = run.state.curriculum.status();
    for level_move in &moves {
        run.emit(&RunEvent::Move(level_move))?;
    }
    for status in &after {
        // The texts of warnings contain counts and change, so that only a growing number of warnings is news.
        let known =
            before.iter().find(|known| known.task == status.task).map_or(0, |known| known.warnings.len());
        for message in status.warnings.iter().skip(known) {
            run.emit(&RunEvent::Warning { task: Some(&status.task), message })?;
        }
    }
    if !before.iter().map(|status| status.epoch).eq(after.iter().map(|status| status.epoch)) {
        proposal_queue::drop_stale(run).await?;
    }
    Ok(moves)
}
