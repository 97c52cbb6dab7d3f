//! Retires layouts that the server judges otherwise than the worker that designed them. Groups that were leased before stay.

use job_queue::status::WrongLayout;
use store::ids::LayoutId;
use store::{corrections, design_queue, layout_transitions, layouts, runs};

use crate::designs::layout_status::LayoutStatus;
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;

/// Reason in the history of a layout.
const REASON: &str = "the server judges it otherwise than the worker that designed it";

/// Retires layouts for good.
#[derive(Debug, Clone)]
pub struct RetireWrongLayouts(pub Vec<WrongLayout>);

/// Layouts that were retired, and those that can still be stored.
#[derive(Debug, Default)]
pub struct RetiredLayouts {
    /// Number of layouts that were retired now.
    pub retired: usize,
    /// Layouts that the database does not have, whose run has a design request that has not ended: it can bring them.
    pub expected: Vec<WrongLayout>,
}

impl Change for RetireWrongLayouts {
    type Output = RetiredLayouts;

    async fn apply(self, tx: &mut WriteTx) -> Result<RetiredLayouts, ServiceError> {
        let mut result = RetiredLayouts::default();
        for wrong in self.0 {
            if !runs::exists(&mut tx.conn, &wrong.run).await? {
                continue; // it was deleted meanwhile
            }
            let stored = corrections::layouts_of(&mut tx.conn, &wrong.run, &wrong.scenario.0).await?;
            if stored.is_empty() && design_queue::count_running(&mut tx.conn, &wrong.run).await? > 0 {
                result.expected.push(wrong);
                continue;
            }
            for number in stored {
                result.retired += usize::from(retire(tx, &wrong, number).await?);
            }
        }
        Ok(result)
    }
}

/// Retires a layout, and warns its run. Returns false if the layout is retired as wrong already.
async fn retire(tx: &mut WriteTx, wrong: &WrongLayout, number: i64) -> Result<bool, ServiceError> {
    let row = layouts::get(&mut tx.conn, number).await?;
    let status = row.and_then(|row| LayoutStatus::from_stored(row.state, row.retirement_reason));
    if status.is_none_or(|status| status == LayoutStatus::Wrong) {
        return Ok(false);
    }
    let transition = LayoutStatus::Wrong.transition(REASON.to_owned());
    layout_transitions::change_state(&mut tx.conn, number, &transition, tx.now).await?;
    let layout = LayoutId::of_run(&wrong.run, number);
    let message = format!("{layout} of an expelled worker is retired: {REASON}.");
    tx.emit(&wrong.run, &RunEvent::Warning { task: Some(&wrong.task), message: &message })?;
    Ok(true)
}
