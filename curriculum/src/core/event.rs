//! Stored events of a curriculum.

use serde::{Deserialize, Serialize};

use super::outcome::GroupOutcome;
use super::proposal::Proposal;
use super::settings::StoredSettings;

/// Stored event; a curriculum is the fold over its events in the order of their seq.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", content = "data", rename_all = "snake_case")]
pub enum CurriculumEvent {
    /// The curriculum made a proposal.
    Proposed(Proposal),
    /// The curriculum received the outcome of a group.
    Outcome(GroupOutcome),
    /// The user changed the settings.
    Settings(StoredSettings),
}
