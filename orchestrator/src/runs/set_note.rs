//! Sets the note of a run.

use api_types::RunNoteRequest;
use store::ids::RunId;
use store::runs::{self, RunRow};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::runs::validate::check_run_note;

/// Sets the note of a run.
#[derive(Debug)]
pub struct SetNote {
    run: RunId,
    note: String,
}

impl SetNote {
    /// Checks a request.
    ///
    /// # Errors
    /// Returns an error that names the field `note` if it is too long.
    pub fn from_request(run: RunId, request: RunNoteRequest) -> Result<Self, ServiceError> {
        check_run_note(&request.note)?;
        Ok(Self { run, note: request.note })
    }
}

impl Change for SetNote {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let id = self.run.as_str();
        let mut run = tx.run(id).await?;
        runs::set_note(run.conn, id, &self.note).await?;
        run.emit(&RunEvent::Run { state: "annotated" })?;
        runs::get(run.conn, id).await?.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))
    }
}
