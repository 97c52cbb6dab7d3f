//! Stored events of a curriculum.

use serde::{Deserialize, Serialize};

use super::outcome::GroupOutcome;
use super::proposal::Proposal;
use super::settings::StoredSettings;
use super::slot::Slot;

/// Stored event; a curriculum is the fold over its events in the order of their seq.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", content = "data", rename_all = "snake_case")]
pub enum CurriculumEvent {
    /// The curriculum made a proposal.
    Proposed(Proposal),
    /// A trainer received groups that are slots.
    Opened(Vec<Slot>),
    /// The server lost groups that no trainer saw; they are no slots any more.
    Withdrawn(Vec<Slot>),
    /// The curriculum received the outcome of a group.
    Outcome(GroupOutcome),
    /// The user changed the settings.
    Settings(StoredSettings),
    /// The user changed a rule by which results become evidence. The evidence before it is dropped.
    EvidenceRestarted,
}
