//! Samplers: strategies that react to every group. They choose the rung of the next scenario by the agent's latest results, and
//! claim no mastery, which the server measures under every strategy.
//!
//! [`Sampled`] keeps one [`Sampler`] for each task, shares the proposals between the tasks, and adds coverage.
//!
//! - `staircase`: many chains, each one step up after a success and one down after a failure.
//! - `controller`: one position for a task, moved towards a success rate of one half.
//! - `bandit`: rungs weighted by p(1 − p) of their success rate p.
//! - `auto`: the sampler that a table names for the task.
//! - `coverage`: the share of steps that is drawn from all rungs.

mod auto;
mod bandit;
mod controller;
mod coverage;
mod episode_length;
mod staircase;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use env_core::KeyedRng;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

pub(super) use self::auto::Auto;
pub(super) use self::bandit::Bandit;
pub(super) use self::controller::Controller;
use self::coverage::Coverage;
pub(super) use self::staircase::Staircase;
use crate::core::evidence::level_move::LevelMove;
use crate::core::explanation::Explanation;
use crate::core::outcome::GroupOutcome;
use crate::core::probabilities::{mix, uniform_probabilities};
use crate::core::proposal::{Proposal, ProposalRole};
use crate::core::rungs::{RungKind, RungScale};
use crate::core::sampler_state::{SamplerChoice, SamplerOutlook};
use crate::core::settings::{Hyperparameters, Settings, TaskPlan};
use crate::core::shares;
use crate::core::strategy::{Strategy, StrategyContext, StrategyState, drop_stale_tasks};

/// Chooses the rungs of one task.
pub(super) trait Sampler: Clone + Serialize + DeserializeOwned + Send + Sync + 'static {
    /// Version of the rules and the state.
    const VERSION: u32;
    /// Summary in one sentence.
    const SUMMARY: &'static str;

    /// A sampler before its first result.
    fn new(plan: &TaskPlan) -> Self;

    /// Share of the steps that is drawn from all rungs, 0 to 1.
    fn coverage(&self, hyperparameters: &Hyperparameters) -> f64;

    /// Chooses the next rung.
    fn choose(&self, setting: &SamplerSetting<'_>, rng: &mut KeyedRng) -> ChosenRung;

    /// Takes a result into account.
    fn observe(&mut self, result: &RungResult, setting: &SamplerSetting<'_>, rng: KeyedRng);

    /// True if scenarios must be contested: in tasks in which a blind plan can succeed.
    fn is_contested(&self, setting: &SamplerSetting<'_>) -> bool {
        setting.rungs.can_be_blind()
    }

    /// Probability of each rung with the next choice; `None` if levels are drawn uniformly although the task has start rungs.
    fn probabilities(&self, setting: &SamplerSetting<'_>) -> Option<Vec<f64>>;

    /// Number of chains at each rung; `None` if the sampler has no chains.
    fn chains(&self, _setting: &SamplerSetting<'_>) -> Option<Vec<u32>> {
        None
    }

    /// Sampler that was chosen for the task; `None` if the strategy has one for all tasks.
    fn choice(&self, _plan: &TaskPlan) -> Option<SamplerChoice> {
        None
    }

    /// Describes the state in one sentence.
    fn describe(&self, plan: &TaskPlan, setting: &SamplerSetting<'_>) -> String;

    /// Positions on the rungs: lower quartile, median and upper quartile; `None` if the sampler has none.
    fn quartiles(&self, _setting: &SamplerSetting<'_>) -> Option<[f64; 3]> {
        None
    }
}

/// Rungs of a task, and the values of the strategy's hyperparameters.
#[derive(Clone, Copy)]
pub(super) struct SamplerSetting<'a> {
    rungs: RungScale<'a>,
    hyperparameters: &'a Hyperparameters,
}

/// Choice of a rung, with its reason in a few words.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ChosenRung {
    rung: u32,
    /// Chain of a staircase that chose it.
    chain: Option<u32>,
    why: String,
}

/// Result of a group at a rung.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RungResult {
    rung: u32,
    chain: Option<u32>,
    successes: u32,
    failures: u32,
    /// Steps of all episodes together.
    steps: u64,
}

/// Strategy that has a sampler for each task.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(bound = "S: Sampler")]
pub(super) struct Sampled<S> {
    tasks: BTreeMap<String, TaskState<S>>,
}

/// State of a task.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(bound = "S: Sampler")]
struct TaskState<S> {
    sampler: S,
    coverage: Coverage,
}

impl<S: Sampler> Strategy for Sampled<S> {
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal {
        let mut rng = ctx.rng();
        let plan = shares::pick_task(ctx.settings, rng.uniform());
        let setting = SamplerSetting::new(plan, ctx.settings);
        let state = self.tasks.entry(plan.task.clone()).or_insert_with(|| TaskState::new(plan));
        let coverage = state.coverage_probability(&setting);
        // Without coverage nothing is drawn for it, so that `auto` makes the draws of `uniform` where it draws levels uniformly.
        if coverage > 0.0 && rng.bernoulli(coverage) {
            let rung = rng.below(setting.rungs.len());
            let why = format!("{}, drawn uniformly, so that no rung is forgotten", setting.name(rung));
            return Proposal { why, ..setting.rungs.propose(rung, ProposalRole::Coverage, &mut rng) };
        }
        let ChosenRung { rung, chain, why } = state.sampler.choose(&setting, &mut rng);
        let why = format!("{}: {why}", setting.name(rung));
        let contested = state.sampler.is_contested(&setting);
        Proposal { contested, chain, why, ..setting.rungs.propose(rung, ProposalRole::Rung, &mut rng) }
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        let Some(plan) = ctx.settings.task(&outcome.task).filter(|_| outcome.usable && outcome.finished > 0)
        else {
            return Vec::new();
        };
        let state = self.tasks.entry(plan.task.clone()).or_insert_with(|| TaskState::new(plan));
        let is_coverage = outcome.role == ProposalRole::Coverage;
        state.coverage.observe(is_coverage, outcome.steps, outcome.finished);
        let setting = SamplerSetting::new(plan, ctx.settings);
        if let Some(rung) = setting.rungs.rung(outcome.start_rung, outcome.level)
            && outcome.role == ProposalRole::Rung
        {
            let successes = outcome.successes.min(outcome.finished);
            let (failures, steps) = (outcome.finished - successes, outcome.steps);
            let result = RungResult { rung, chain: outcome.chain, successes, failures, steps };
            state.sampler.observe(&result, &setting, ctx.rng());
        }
        Vec::new()
    }

    fn change_settings(&mut self, restarted: &[&str], ctx: &StrategyContext<'_>) {
        drop_stale_tasks(&mut self.tasks, restarted, ctx);
    }

    fn sampler(&self, plan: &TaskPlan, ctx: &StrategyContext<'_>) -> SamplerOutlook {
        let setting = SamplerSetting::new(plan, ctx.settings);
        match self.tasks.get(&plan.task) {
            Some(state) => state.outlook(plan, &setting),
            None => TaskState::<S>::new(plan).outlook(plan, &setting),
        }
    }

    fn sample_rung(&self, plan: &TaskPlan, settings: &Settings, rng: &mut KeyedRng) -> Option<u32> {
        let setting = SamplerSetting::new(plan, settings);
        let chosen = match self.tasks.get(&plan.task) {
            Some(state) => state.sampler.choose(&setting, rng),
            None => S::new(plan).choose(&setting, rng),
        };
        Some(chosen.rung)
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        let rules = vec![
            "Tasks share the proposals by weight, each at least 5 %.".to_owned(),
            "A task with start rungs has these as its rungs, and its level is drawn uniformly; any other task has its levels."
                .to_owned(),
            "Scenarios are contested in tasks in which a blind plan can succeed; those drawn from all rungs are as they come.".to_owned(),
        ];
        Explanation::without_levels(settings, S::VERSION, S::SUMMARY, rules, |plan| {
            let setting = SamplerSetting::new(plan, settings);
            match self.tasks.get(&plan.task) {
                Some(state) => state.explain(plan, &setting),
                None => TaskState::<S>::new(plan).explain(plan, &setting),
            }
        })
    }
}

impl<S: Sampler> StrategyState for Sampled<S> {
    const VERSION: u32 = S::VERSION;

    fn new(_settings: &Settings) -> Self {
        Self { tasks: BTreeMap::new() }
    }
}

impl<S: Sampler> TaskState<S> {
    fn new(plan: &TaskPlan) -> Self {
        Self { sampler: S::new(plan), coverage: Coverage::default() }
    }

    /// Probability that the next proposal is drawn for coverage.
    fn coverage_probability(&self, setting: &SamplerSetting<'_>) -> f64 {
        let share = self.sampler.coverage(setting.hyperparameters);
        self.coverage.probability(share, || f64::from(setting.rungs.horizon()))
    }

    fn outlook(&self, plan: &TaskPlan, setting: &SamplerSetting<'_>) -> SamplerOutlook {
        let rungs = setting.rungs;
        let (kind, probabilities) = match self.sampler.probabilities(setting) {
            Some(chosen) => {
                let covered = uniform_probabilities(rungs.len());
                (rungs.kind(), mix(self.coverage_probability(setting), &covered, &chosen))
            }
            None => (RungKind::Level, uniform_probabilities(rungs.count(RungKind::Level))),
        };
        SamplerOutlook {
            choice: self.sampler.choice(plan),
            state: Some(self.sampler.describe(plan, setting)),
            kind: Some(kind),
            probabilities: Some(probabilities),
            chains: self.sampler.chains(setting),
            quartiles: self.sampler.quartiles(setting),
        }
    }

    /// Describes the sampler and its state in one sentence.
    fn explain(&self, plan: &TaskPlan, setting: &SamplerSetting<'_>) -> String {
        let state = self.sampler.describe(plan, setting);
        match self.sampler.choice(plan) {
            Some(SamplerChoice { name, reason }) => format!("{name}, because {reason}: {state}"),
            None => state,
        }
    }
}

impl<'a> SamplerSetting<'a> {
    fn new(plan: &'a TaskPlan, settings: &'a Settings) -> Self {
        Self { rungs: RungScale::new(plan), hyperparameters: &settings.hyperparameters }
    }

    /// Name of a rung.
    fn name(&self, rung: u32) -> String {
        if self.rungs.are_starts() {
            format!("start rung {rung} of {}", self.rungs.top())
        } else {
            format!("level {rung} of {}", self.rungs.top())
        }
    }
}
