//! What a curriculum is brought back from.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::event::Proposal;
use super::kind::StrategyKind;
use super::mastery::StoredMastery;
use super::settings::SettingsError;
use super::stored::StoredSettings;

/// A curriculum at one moment, complete but for the run's seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// The strategy that wrote `state`.
    pub strategy: StrategyKind,
    /// The version of its rules and state.
    pub version: u32,
    /// The strategy's own state.
    pub state: Value,
    /// The settings in force.
    pub settings: StoredSettings,
    /// The values behind the mastery of every task and level.
    pub mastery: Vec<StoredMastery>,
    /// Per task, the seq since which its proposals are made by these settings; absent: since the beginning.
    pub since: BTreeMap<String, u64>,
    /// The seq of the next event.
    pub next_seq: u64,
}

/// Why a stored curriculum cannot be brought back. After an error from a replay the curriculum has gone part of the
/// way and must be dropped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RestoreError {
    /// Written by other rules than those of this program.
    #[error(
        "the snapshot is of version {found} of the strategy {strategy}, and this program has version {wanted}; run the \
         program that wrote it, or start a new run"
    )]
    OtherVersion {
        /// The strategy.
        strategy: StrategyKind,
        /// The version in the snapshot.
        found: u32,
        /// The version of this program.
        wanted: u32,
    },
    /// Settings that cannot be.
    #[error("the stored settings cannot be used: {0}")]
    Settings(#[from] SettingsError),
    /// A state that the strategy cannot read.
    #[error("the stored state of the strategy {strategy} cannot be read: {reason}")]
    State {
        /// The strategy.
        strategy: StrategyKind,
        /// Why.
        reason: String,
    },
    /// An event is missing, doubled or out of order.
    #[error("the stored event has seq {found}, but the next is {wanted}")]
    OutOfOrder {
        /// The seq found.
        found: u64,
        /// The seq that comes next.
        wanted: u64,
    },
    /// The stored proposal is not what these settings and events lead to.
    #[error(
        "event {seq}: the store says {stored:?} was proposed, but the events before it lead to {proposed:?}"
    )]
    OtherProposal {
        /// The event's seq.
        seq: u64,
        /// What the store says.
        stored: Box<Proposal>,
        /// What is proposed now.
        proposed: Box<Proposal>,
    },
}
