//! Shards whose part of a list is missing.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Shard whose server did not answer, so that its part of a list is missing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct MissingShard {
    /// Name of the shard.
    #[schema(example = "west")]
    pub shard: String,
    /// Reason, as a clause for people.
    #[schema(example = "the server cannot be reached")]
    pub reason: String,
}
