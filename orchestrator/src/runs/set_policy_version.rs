//! Sets the newest policy version of a run.

use store::ids::RunId;
use store::runs::{self, RunRow};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::ownership::Actor;
use crate::runs::version_step::check_version_step;

/// Sets the newest policy version of a run. Reported results raise it automatically; a wrong one stays until it is set.
#[derive(Debug)]
pub struct SetPolicyVersion {
    /// Id of the run.
    pub run: RunId,
    /// The newest policy version.
    pub policy_version: u32,
    /// Client that sets the version. Only an admin can set one far above the newest.
    pub actor: Actor,
}

impl Change for SetPolicyVersion {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let id = self.run.as_str();
        let mut run = tx.run(id).await?;
        if !self.actor.is_admin() {
            check_version_step("policy_version", self.policy_version, run.state.policy_version)?;
        }
        run.set_policy_version(i64::from(self.policy_version)).await?;
        runs::get(run.conn, id).await?.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))
    }
}
