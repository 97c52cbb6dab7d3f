//! What every strategy answers to.

use std::sync::Arc;

use env_core::draws::{Draws, Purpose};
use serde_json::Value;

use super::adr::Adr;
use super::alp_gmm::AlpGmm;
use super::event::{GroupOutcome, Move, Proposal};
use super::explain::{Explanation, TaskStatus};
use super::fixed::Fixed;
use super::kind::StrategyKind;
use super::ladder::Ladder;
use super::learnability::Learnability;
use super::replay::Replay;
use super::restore::RestoreError;
use super::settings::Settings;
use super::uniform::Uniform;

/// What a strategy may look at besides its own state.
#[derive(Debug, Clone, Copy)]
pub struct Context<'a> {
    /// The settings in force.
    pub settings: &'a Settings,
    /// The run's seed.
    pub run_seed: u64,
    /// The seq of the event being made.
    pub seq: u64,
}

impl Context<'_> {
    /// The draws of this event, from the first: a function of (run seed, seq).
    #[must_use]
    pub fn draws(&self) -> Draws {
        Draws::new(Purpose::Course, self.run_seed, self.seq)
    }
}

/// Chooses what a run faces next. Pure: its state, the context and the outcomes decide everything.
pub trait Strategy: Send + Sync {
    /// What to face next.
    fn propose(&mut self, ctx: &Context<'_>) -> Proposal;
    /// Takes an outcome; the moves it caused.
    fn observe(&mut self, outcome: &GroupOutcome, ctx: &Context<'_>) -> Vec<Move>;
    /// Takes changed settings, which `ctx` holds: tasks in `afresh` are new or mean something else than before, tasks
    /// that are gone are forgotten.
    fn adopt(&mut self, afresh: &[&str], ctx: &Context<'_>);
    /// How many moves a task has had. A proposal of an earlier epoch is stale.
    fn epoch(&self, _task: &str) -> u32 {
        0
    }
    /// The seqs of proposals whose scenarios may be wanted again.
    fn held(&self) -> Vec<u64> {
        Vec::new()
    }
    /// Work that would take long where its result is due, each piece told of once: whoever has time may do it before.
    fn jobs(&self) -> Vec<Arc<dyn Job>> {
        Vec::new()
    }
    /// Where each task stands.
    fn status(&self, settings: &Settings) -> Vec<TaskStatus>;
    /// For people: what moved, on what evidence, and by which rules.
    fn explain(&self, settings: &Settings) -> Explanation;
    /// Its whole state.
    fn snapshot(&self) -> Value;
    /// The version of its rules and state. Raised by whatever makes a stored run go another way.
    fn version(&self) -> u32;
    /// A copy.
    fn boxed_clone(&self) -> Box<dyn Strategy>;
}

/// Work of a strategy that may be done anywhere and at any time: its result is a function of what it was begun with.
pub trait Job: Send + Sync {
    /// Does it; nothing happens where it was done.
    fn run(&self);
}

/// A strategy at its start.
pub(super) fn fresh(settings: &Settings) -> Box<dyn Strategy> {
    match settings.strategy {
        StrategyKind::Ladder => Box::new(Ladder::new(settings)),
        StrategyKind::Uniform => Box::new(Uniform),
        StrategyKind::Fixed => Box::new(Fixed::default()),
        StrategyKind::Adr => Box::new(Adr::default()),
        StrategyKind::Learnability => Box::new(Learnability::default()),
        StrategyKind::Plr | StrategyKind::PlrRobust | StrategyKind::Accel => Box::new(Replay::new(settings)),
        StrategyKind::AlpGmm => Box::new(AlpGmm::default()),
    }
}

/// A strategy as it was.
pub(super) fn restored(
    settings: &Settings,
    version: u32,
    state: &Value,
) -> Result<Box<dyn Strategy>, RestoreError> {
    let strategy = settings.strategy;
    let wanted = fresh(settings).version();
    if version != wanted {
        return Err(RestoreError::OtherVersion { strategy, found: version, wanted });
    }
    let broken = |reason: String| RestoreError::State { strategy, reason };
    let read = |error: serde_json::Error| broken(error.to_string());
    Ok(match strategy {
        StrategyKind::Ladder => Box::new(Ladder::restore(settings, state).map_err(broken)?),
        StrategyKind::Uniform => Box::new(Uniform),
        StrategyKind::Fixed => Box::new(Fixed::restore(state).map_err(read)?),
        StrategyKind::Adr => Box::new(Adr::restore(settings, state).map_err(broken)?),
        StrategyKind::Learnability => Box::new(Learnability::restore(state).map_err(read)?),
        StrategyKind::Plr | StrategyKind::PlrRobust | StrategyKind::Accel => {
            Box::new(Replay::restore(settings, state).map_err(read)?)
        }
        StrategyKind::AlpGmm => Box::new(AlpGmm::restore(state).map_err(read)?),
    })
}
