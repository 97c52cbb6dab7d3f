//! Stores what a client says about a version of a run's policy.

use api_types::PolicyVersionDescription;
use store::ids::RunId;
use store::policy_versions::{self, PolicyVersionRow};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::ownership::Actor;
use crate::runs::version_step::check_version_step;

/// Maximum length of a checkpoint or of notes, in characters.
const MAX_DESCRIPTION_CHARS: usize = 2000;

/// Describes a policy version. A version above the run's newest becomes the newest; only an admin can describe one far above.
#[derive(Debug)]
pub struct DescribePolicyVersion {
    run: RunId,
    version: u32,
    actor: Actor,
    request: PolicyVersionDescription,
}

impl DescribePolicyVersion {
    /// Checks a request.
    ///
    /// # Errors
    /// Returns an error that names the field that is too long.
    pub fn from_request(
        run: RunId,
        version: u32,
        actor: Actor,
        request: PolicyVersionDescription,
    ) -> Result<Self, ServiceError> {
        for (field, text) in [("checkpoint", &request.checkpoint), ("notes", &request.notes)] {
            if text.as_ref().is_some_and(|text| text.chars().count() > MAX_DESCRIPTION_CHARS) {
                let reason = format!("must have at most {MAX_DESCRIPTION_CHARS} characters");
                return Err(ServiceError::invalid(field, reason));
            }
        }
        Ok(Self { run, version, actor, request })
    }
}

impl Change for DescribePolicyVersion {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let id = self.run.as_str();
        let mut run = tx.run(id).await?;
        if !self.actor.is_admin() {
            check_version_step("version", self.version, run.state.policy_version)?;
        }
        let version = i64::from(self.version);
        let PolicyVersionDescription { checkpoint, notes } = self.request;
        policy_versions::put(run.conn, id, &PolicyVersionRow { version, checkpoint, notes, at: run.now })
            .await?;
        if version > run.state.policy_version {
            run.set_policy_version(version).await?;
        }
        Ok(())
    }
}
