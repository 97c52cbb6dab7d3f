//! The rule by which the ladder moves.

use serde::{Deserialize, Serialize};

/// Rule by which the ladder moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Target {
    /// Moves up when the level is mastered.
    Mastery,
    /// Keeps success near one half, where rewards within a group vary most. Claims no mastery.
    Half,
}

impl Target {
    /// Default target for a group size. Algorithms that use groups learn from differences between episodes of one
    /// scenario, which are greatest at a success rate of one half.
    #[must_use]
    pub const fn default_for_group_size(group_size: u32) -> Self {
        if group_size > 1 { Self::Half } else { Self::Mastery }
    }
}
