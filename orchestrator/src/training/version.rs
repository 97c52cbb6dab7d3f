//! Telling of versions of a run's policy.

use serde::Deserialize;
use utoipa::ToSchema;

use super::{Change, TrainingError, Work};
use crate::ids::RunId;
use crate::store::runs;
use crate::store::versions::{self, VersionRow};

/// Longest words about a version, in characters.
const MOST: usize = 2000;

/// What a version of a policy is.
#[derive(Debug, Clone, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VersionWish {
    /// Where its weights are, in your own words: a path, an address, a commit.
    #[schema(example = "checkpoints/step-1200")]
    pub checkpoint: Option<String>,
    /// Whatever else should be known of it.
    pub notes: Option<String>,
}

/// Tells of a version; the newest that is told of is the newest there is.
#[derive(Debug)]
pub struct PutVersion {
    run: RunId,
    version: u32,
    wish: VersionWish,
}

impl PutVersion {
    /// Reads a wish.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read(run: RunId, version: u32, wish: VersionWish) -> Result<Self, TrainingError> {
        for (field, words) in [("checkpoint", &wish.checkpoint), ("notes", &wish.notes)] {
            if words.as_ref().is_some_and(|words| words.chars().count() > MOST) {
                return Err(TrainingError::invalid(field, format!("at most {MOST} characters are taken")));
            }
        }
        Ok(Self { run, version, wish })
    }
}

impl Change for PutVersion {
    type Answer = ();

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        let (run, at) = (self.run.as_str(), work.now);
        let (mind, conn) = work.mind(run).await?;
        let version = i64::from(self.version);
        let VersionWish { checkpoint, notes } = self.wish;
        versions::put(conn, run, &VersionRow { version, checkpoint, notes, at }).await?;
        if version > mind.policy_version {
            mind.policy_version = version;
            runs::set_policy_version(conn, run, version).await?;
        }
        Ok(())
    }
}
