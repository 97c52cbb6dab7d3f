//! Sets how many episodes a run keeps whole.

use api_types::RetentionRequest;
use store::ids::RunId;
use store::runs::{self, RunRow};
use store::to_json;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Sets how many episodes a run keeps whole.
#[derive(Debug)]
pub struct SetRetention {
    /// Id of the run.
    pub run: RunId,
    /// Limits to change, and their values.
    pub request: RetentionRequest,
}

impl Change for SetRetention {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let id = self.run.as_str();
        let mut run = tx.run(id).await?;
        run.state.settings.retention = run.state.settings.retention.with(self.request);
        runs::set_settings(run.conn, id, &to_json(&run.state.settings)?, run.now).await?;
        runs::get(run.conn, id).await?.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))
    }
}
