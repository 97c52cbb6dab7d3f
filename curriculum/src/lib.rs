//! What a run faces next, and why: the one place where difficulty changes.
//!
//! Pure decisions. Nothing here knows a database, HTTP, a clock, async or ambient randomness. A run's curriculum is a
//! **fold over its events** ([`CurriculumEvent`], in the order of their seq): every proposal, outcome and change of
//! settings takes one seq, and randomness is a function of (run seed, seq), so no generator is stored and a restored
//! run proposes what it would have proposed.
//!
//! - [`Curriculum`] is the fold: a [`Strategy`], the mastery it rests on, the settings and the next seq.
//! - [`Settings`] say which tasks, tables and rules; [`Proposal`] and [`GroupOutcome`] go out and come back.
//! - One strategy a file: `ladder` (the default); `uniform` and `fixed` (the baselines); `adr`, `learnability`, `replay` (plr,
//!   plr_robust, accel) and `alp_gmm`.

mod adr;
mod alp_gmm;
mod block;
mod event;
mod explain;
mod fixed;
mod fold;
mod kind;
mod ladder;
mod learnability;
mod mastery;
mod placement;
mod posterior;
mod replay;
mod restore;
mod scale;
mod settings;
mod shares;
pub mod simulation;
mod stored;
mod strategy;
#[cfg(test)]
mod tests;
mod tuning;
mod uniform;

pub use event::{
    BlockEvidence, CurriculumEvent, Evidence, GroupOutcome, Move, MoveKind, ProbeEvidence, Proposal, Role,
    Signals, Source,
};
pub use explain::{BlockFill, Explanation, TaskExplanation, TaskStatus, Thresholds};
pub use fold::Curriculum;
pub use kind::StrategyKind;
pub use mastery::{Mastery, StoredMastery};
pub use restore::{RestoreError, Snapshot};
pub use scale::difficulty;
pub use settings::{Settings, SettingsError, Target, TaskPlan};
pub use stored::{StoredSettings, StoredTaskPlan};
pub use strategy::{Context, Job, Strategy};
pub use tuning::{Hyper, Range, Tuning};
