//! Sets the newest policy version of a run.

use store::ids::RunId;
use store::runs::{self, RunRow};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Sets the newest policy version of a run. Reported results raise it automatically; a wrong one stays until it is set.
#[derive(Debug)]
pub struct SetPolicyVersion {
    /// Id of the run.
    pub run: RunId,
    /// The newest policy version.
    pub policy_version: u32,
}

impl Change for SetPolicyVersion {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let id = self.run.as_str();
        let run = tx.run(id).await?;
        run.state.policy_version = i64::from(self.policy_version);
        runs::set_policy_version(run.conn, id, run.state.policy_version).await?;
        runs::get(run.conn, id).await?.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))
    }
}
