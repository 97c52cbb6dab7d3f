//! Telling of versions of a run's policy.

use serde::Deserialize;
use utoipa::ToSchema;

use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use crate::ids::RunId;
use crate::store::runs;
use crate::store::policy_versions::{self, PolicyVersionRow};

/// Longest words about a version, in characters.
const MOST: usize = 2000;

/// What a version of a policy is.
#[derive(Debug, Clone, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VersionRequest {
    /// Where its weights are, in your own words: a path, an address, a commit.
    #[schema(example = "checkpoints/step-1200")]
    pub checkpoint: Option<String>,
    /// Whatever else should be known of it.
    pub notes: Option<String>,
}

/// Tells of a version; the newest that is told of is the newest there is.
#[derive(Debug)]
pub struct DescribeVersion {
    run: RunId,
    version: u32,
    wish: VersionRequest,
}

impl DescribeVersion {
    /// Reads a wish.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read(run: RunId, version: u32, wish: VersionRequest) -> Result<Self, ServiceError> {
        for (field, words) in [("checkpoint", &wish.checkpoint), ("notes", &wish.notes)] {
            if words.as_ref().is_some_and(|words| words.chars().count() > MOST) {
                return Err(ServiceError::invalid(field, format!("at most {MOST} characters are taken")));
            }
        }
        Ok(Self { run, version, wish })
    }
}

impl Change for DescribeVersion {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let (run, at) = (self.run.as_str(), tx.now);
        let RunTx { state: mind, conn, .. } = tx.run(run).await?;
        let version = i64::from(self.version);
        let VersionRequest { checkpoint, notes } = self.wish;
        policy_versions::put(conn, run, &PolicyVersionRow { version, checkpoint, notes, at }).await?;
        if version > mind.policy_version {
            mind.policy_version = version;
            runs::set_policy_version(conn, run, version).await?;
        }
        Ok(())
    }
}
