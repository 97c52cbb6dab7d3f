//! Stored form of a whole curriculum.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::mastery::StoredMastery;
use super::proposal::Proposal;
use super::rung_tracker::RungTracker;
use super::settings::{SettingsError, StoredSettings, StrategyKind};

/// State of a curriculum at one event, complete except for the run seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Strategy that wrote `state`.
    pub strategy: StrategyKind,
    /// Version of the strategy's rules and state.
    pub version: u32,
    /// State of the strategy.
    pub state: Value,
    /// Settings that were in force.
    pub settings: StoredSettings,
    /// Success rates behind the mastery of every task and level.
    pub mastery: Vec<StoredMastery>,
    /// Latest draws and successes of each rung; empty in a snapshot of an earlier version.
    #[serde(default)]
    pub(crate) rungs: RungTracker,
    /// Per task, the seq from which its proposals follow these settings; a missing task has followed them from the
    /// start.
    pub since: BTreeMap<String, u64>,
    /// Seq of the next event.
    pub next_seq: u64,
}

/// Reason why a stored curriculum cannot be restored. After an error from an event replay the curriculum is in an
/// intermediate state and must be dropped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RestoreError {
    /// The snapshot was written by a version with other rules.
    #[error(
        "the snapshot is of version {found} of the strategy {strategy}, and this program has version \
         {wanted}; run the program that wrote it, or start a new run"
    )]
    OtherVersion {
        /// Strategy of the snapshot.
        strategy: StrategyKind,
        /// Version in the snapshot.
        found: u32,
        /// Version of this program.
        wanted: u32,
    },
    /// The stored settings are invalid.
    #[error("the stored settings cannot be used: {0}")]
    Settings(#[from] SettingsError),
    /// The strategy cannot read its stored state.
    #[error("the stored state of the strategy {strategy} cannot be read: {reason}")]
    State {
        /// Strategy of the snapshot.
        strategy: StrategyKind,
        /// Cause of the failure.
        reason: String,
    },
    /// An event is missing, duplicated or out of order.
    #[error("the stored event has seq {found}, but the next is {wanted}")]
    OutOfOrder {
        /// Seq of the stored event.
        found: u64,
        /// Seq that comes next.
        wanted: u64,
    },
    /// The stored proposal differs from the one that the settings and events lead to.
    #[error(
        "event {seq}: the store says {stored:?} was proposed, but the events before it lead to {proposed:?}"
    )]
    OtherProposal {
        /// Seq of the event.
        seq: u64,
        /// Proposal in the store.
        stored: Box<Proposal>,
        /// Proposal that the curriculum makes now.
        proposed: Box<Proposal>,
    },
}
