//! Adaptive curriculum: decides which task, level and scenario a run faces next, and explains why.
//!
//! # Where does difficulty change?
//!
//! In `strategies/`, and nowhere else. Under the default strategy, `strategies/samplers/auto.rs` names the sampler of a task.
//! `strategies/ladder` raises or lowers a task's level; the thresholds and the test behind a move are in
//! `core/evidence/block.rs`.
//!
//! # Layout
//!
//! Lower layers know nothing of the layers above them:
//!
//! 1. `core/`: proposals, outcomes, events, evidence, mastery, settings, and the trait that strategies implement.
//! 2. `strategies/`: one file or folder for each strategy, and the factory that builds them by kind.
//! 3. `curriculum.rs`: [`Curriculum`], the fold over a run's events. Start reading here.
//! 4. [`simulation`]: curricula against simulated learners of known ability.
//!
//! # Principles
//!
//! - Decisions are pure: no database, HTTP, clock, async code or ambient randomness.
//! - A curriculum is a fold over its [`CurriculumEvent`]s in the order of their seq (sequence number). Each event takes
//!   one seq.
//! - Randomness is a function of run seed and seq. No generator is stored, and a restored run proposes what it would
//!   have proposed.
//! - Snapshots and events are stored as JSON. Their field names are part of the stored format and never change; the
//!   version of a strategy rises when its rules or state do.

mod core;
mod curriculum;
pub mod simulation;
mod strategies;
#[cfg(test)]
mod tests;

pub use self::core::event::CurriculumEvent;
pub use self::core::evidence::interval::{EpisodeTally, SuccessInterval};
pub use self::core::evidence::level_move::{BlockSummary, LevelMove, MoveEvidence, MoveKind, ProbeSummary};
pub use self::core::evidence::posterior::Posterior;
pub use self::core::explanation::{BlockProgress, Explanation, MoveThresholds, TaskExplanation, TaskStatus};
pub use self::core::mastery::{Mastery, StoredMastery};
pub use self::core::outcome::{GroupOutcome, LearningSignals};
pub use self::core::proposal::{Proposal, ProposalRole, ScenarioSource};
pub use self::core::rungs::RungKind;
pub use self::core::sampler_state::{RungState, SamplerState};
pub use self::core::scale::difficulty;
pub use self::core::settings::{
    Hyperparameter, Hyperparameters, Settings, SettingsError, StoredSettings, StoredTaskPlan, StrategyKind,
    Target, TaskPlan, ValueRange,
};
pub use self::core::slot::{Slot, SlotKey, StalledSlot};
pub use self::core::snapshot::{RestoreError, Snapshot};
pub use self::core::strategy::BackgroundJob;
pub use self::curriculum::{Curriculum, ObservedOutcome, SequencedProposal};
