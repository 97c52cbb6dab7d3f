//! How many episodes a run keeps whole.

use api_types::{RetentionLimit, RetentionRequest};
use serde::{Deserialize, Serialize};

/// Episodes that a run keeps whole. Older ones are compacted: how each came out is kept, its actions and scenario only where a
/// level move, a layout or an example of a failure rests on them. Leases for evaluation are never compacted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Retention {
    /// The newest episodes of leases of groups.
    pub episodes: RetentionLimit,
    /// The newest episodes of leases of columns.
    pub claimed: RetentionLimit,
}

impl Default for Retention {
    fn default() -> Self {
        Self { episodes: RetentionLimit::Newest(50_000), claimed: RetentionLimit::Newest(10_000_000) }
    }
}

impl Retention {
    /// Returns this retention with the fields that a request sets.
    #[must_use]
    pub fn with(self, request: RetentionRequest) -> Self {
        Self {
            episodes: request.episodes.unwrap_or(self.episodes),
            claimed: request.claimed.unwrap_or(self.claimed),
        }
    }
}
