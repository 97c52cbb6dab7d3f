//! The trait that every strategy implements.
//!
//! Decisions are in [`Strategy`], the stored form in [`StrategyState`]. Everything that is the same for all
//! strategies (snapshot, version, copy) is derived from the latter by one blanket implementation of
//! [`StrategySnapshot`]. `strategies::create` and `strategies::restore` build strategies by their kind.

use std::collections::BTreeMap;
use std::sync::Arc;

use env_core::keyed_rng::{KeyedRng, RngPurpose};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::evidence::level_move::LevelMove;
use super::explanation::{Explanation, TaskStatus};
use super::outcome::GroupOutcome;
use super::proposal::Proposal;
use super::sampler_state::SamplerOutlook;
use super::settings::{Settings, TaskPlan};
use super::slot::Slot;

/// Inputs of a decision beside the strategy's own state.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StrategyContext<'a> {
    /// Settings that are in force.
    pub(crate) settings: &'a Settings,
    /// Seed of the run.
    pub(crate) run_seed: u64,
    /// Seq of the event being decided.
    pub(crate) seq: u64,
}

impl StrategyContext<'_> {
    /// Random generator of this event, a function of run seed and seq. Each call starts from its first draw.
    #[must_use]
    pub(crate) fn rng(&self) -> KeyedRng {
        KeyedRng::new(RngPurpose::Curriculum, self.run_seed, self.seq)
    }
}

/// Decides what a run faces next. Pure: state, context and outcomes determine every decision.
pub(crate) trait Strategy: StrategySnapshot + Send + Sync {
    /// Makes the next proposal.
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal;
    /// Makes the proposal of a stored event again, with the same effect on the state. `None` if that needs the result of
    /// a background job that has not run: the stored proposal stands, and the state is as it would be.
    fn propose_again(&mut self, ctx: &StrategyContext<'_>) -> Option<Proposal> {
        Some(self.propose(ctx))
    }
    /// Takes note of a slot whose value is due. By default, strategies claim no mastery and keep no evidence.
    fn open_slot(&mut self, _slot: &Slot, _ctx: &StrategyContext<'_>) {}
    /// Drops a slot that will have no value, and returns the level moves that this caused.
    fn withdraw_slot(&mut self, _slot: &Slot, _ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        Vec::new()
    }
    /// Drops the evidence of a task that has not moved a level yet: earlier results have another meaning.
    fn close_epoch(&mut self, _task: &str, _ctx: &StrategyContext<'_>) {}
    /// Takes the outcome of a group into account and returns the level moves it caused.
    fn observe(&mut self, outcome: &GroupOutcome, ctx: &StrategyContext<'_>) -> Vec<LevelMove>;
    /// Adopts changed settings, given in `ctx`. Drops the state of tasks that are gone and restarts the tasks named
    /// in `restarted`, which are new or whose levels changed their meaning.
    fn change_settings(&mut self, restarted: &[&str], ctx: &StrategyContext<'_>);
    /// Number of moves of a task so far. A proposal of an earlier epoch is stale.
    fn epoch(&self, _task: &str) -> u32 {
        0
    }
    /// Seqs of the proposals whose scenarios may be proposed again and must be kept.
    fn retained_proposals(&self) -> Vec<u64> {
        Vec::new()
    }
    /// Expensive work whose result is due later. Each job is returned once; running it early saves time, and skipping
    /// it changes no result.
    fn take_background_jobs(&self) -> Vec<Arc<dyn BackgroundJob>> {
        Vec::new()
    }
    /// Current state of each task. By default, tasks have no current level and their params change with every
    /// proposal.
    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        settings.tasks.iter().map(|plan| TaskStatus::without_levels(&plan.task, Vec::new())).collect()
    }
    /// Rung that the strategy draws for a task; `None` under a strategy that samples no rungs. Nothing changes.
    fn sample_rung(&self, _plan: &TaskPlan, _settings: &Settings, _rng: &mut KeyedRng) -> Option<u32> {
        None
    }
    /// Next draws of a task. By default, the strategy draws levels with unknown probabilities.
    fn sampler(&self, _plan: &TaskPlan, _ctx: &StrategyContext<'_>) -> SamplerOutlook {
        SamplerOutlook::of_levels()
    }
    /// Problems of a task that the user should know about, one sentence each. Cheap: the service compares them after
    /// every outcome.
    fn warnings(&self, _task: &str, _settings: &Settings) -> Vec<String> {
        Vec::new()
    }
    /// Rules, current state and last moves as text.
    fn explain(&self, settings: &Settings) -> Explanation;
}

/// Drops the states of tasks that the settings no longer have or that must restart.
pub(crate) fn drop_stale_tasks<T>(
    tasks: &mut BTreeMap<String, T>,
    restarted: &[&str],
    ctx: &StrategyContext<'_>,
) {
    tasks.retain(|task, _| ctx.settings.task(task).is_some() && !restarted.contains(&task.as_str()));
}

/// Expensive computation that can run on any thread at any time. Its result depends only on the inputs it was created
/// with.
pub trait BackgroundJob: Send + Sync {
    /// Computes the result and keeps it for the strategy; does nothing if it is already there.
    fn run(&self);
}

/// Stored form of a strategy: its state in JSON, by serde.
pub(crate) trait StrategyState: Strategy + Serialize + DeserializeOwned + Clone + 'static {
    /// Version of the strategy's rules and state; raised by every change that makes a stored run continue
    /// differently.
    const VERSION: u32;

    /// A strategy that has seen no event.
    fn new(settings: &Settings) -> Self;

    /// Completes a strategy that was read from its stored form.
    ///
    /// # Errors
    /// Returns a sentence that names the problem if the state does not fit the settings.
    fn resume(self, _settings: &Settings) -> Result<Self, String> {
        Ok(self)
    }
}

/// Snapshot and copy of a boxed strategy; implemented for every [`StrategyState`].
pub(crate) trait StrategySnapshot {
    /// Version of the strategy's rules and state.
    fn version(&self) -> u32;
    /// Complete state of the strategy as JSON.
    fn snapshot(&self) -> Value;
    /// Boxed copy of the strategy.
    fn boxed_clone(&self) -> Box<dyn Strategy>;
}

impl<S: StrategyState> StrategySnapshot for S {
    fn version(&self) -> u32 {
        S::VERSION
    }

    fn snapshot(&self) -> Value {
        serde_json::to_value(self).expect("a state of finite numbers and string keys has a JSON form")
    }

    fn boxed_clone(&self) -> Box<dyn Strategy> {
        Box::new(self.clone())
    }
}
