//! Retires layouts and puts them back, on request of a user.

use sqlx::SqliteConnection;
use store::ids::{LayoutId, RunId};
use store::layouts::{self, LayoutRow};
use store::{layout_outcomes, layout_transitions};

use crate::designs::layout_status::LayoutStatus;
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Retires a layout for good, or puts it back with an empty outcome window. Repeating it has no effect.
#[derive(Debug)]
pub struct SetLayoutRetired {
    /// Id of the run.
    pub run: RunId,
    /// Id of the layout.
    pub layout: LayoutId,
    /// True to retire the layout, false to put it back.
    pub retired: bool,
}

impl Change for SetLayoutRetired {
    type Output = LayoutRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<LayoutRow, ServiceError> {
        tx.run(self.run.as_str()).await?;
        let (now, conn) = (tx.now, &mut tx.conn);
        let row = find_layout(conn, &self.run, &self.layout).await?;
        let refused = || ServiceError::Refused(self.layout.to_string());
        let status = LayoutStatus::from_stored(row.state, row.retirement_reason).ok_or_else(refused)?;
        let (target, reason) = match self.retired {
            true => (LayoutStatus::RetiredByUser, "taken out by hand"),
            false => (LayoutStatus::Active, "put back by hand"),
        };
        // The gate refuses a wrong layout, which stays retired.
        if status == LayoutStatus::Wrong && !self.retired {
            return Err(refused());
        }
        if status == target || status == LayoutStatus::Wrong {
            return Ok(row);
        }
        if !self.retired {
            layout_outcomes::forget_results(conn, row.id).await?;
        }
        layout_transitions::change_state(conn, row.id, &target.transition(reason.to_owned()), now).await?;
        find_layout(conn, &self.run, &self.layout).await
    }
}

/// Returns a layout of a run.
///
/// # Errors
/// Returns [`ServiceError::UnknownLayout`] if the run has no such layout.
pub async fn find_layout(
    conn: &mut SqliteConnection,
    run: &RunId,
    id: &LayoutId,
) -> Result<LayoutRow, ServiceError> {
    let row = layouts::get(conn, id.number).await?;
    let row = row.filter(|row| row.run == run.as_str() && id.may_be_of(run));
    row.ok_or_else(|| ServiceError::UnknownLayout(id.to_string()))
}
