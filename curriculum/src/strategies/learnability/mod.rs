//! Learnability: prefers scenarios on which the agent succeeds sometimes, neither always nor never.
//!
//! By default no scenario is rolled out only to be scored (`rank: model`): a logistic model ([`model`]) over params and the blind
//! panel's success predicts p, draws the level by p(1 − p), and chooses among several fresh scenarios the one nearest one half.
//! Half of the proposals are chosen by it, from the first on; the others are fresh.
//!
//! With `rank: rollouts` it is sampling for learnability (Rutherford et al. 2024): of N fresh scenarios, each rolled out L times,
//! those with the highest k(L − k)/(L(L − 1)) are kept until the next N are complete. Half of the proposals come from those kept,
//! half are fresh. The fresh half serves as the candidates: a service has no rollouts to spare, and the agent may as well learn
//! from them. The estimate uses the rollouts themselves. p(1 − p) of a posterior mean would rank scenarios without rollouts first.

mod explain;
mod model;
mod outlook;

use std::collections::{BTreeMap, VecDeque};

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use self::model::SuccessModel;
use crate::core::evidence::level_move::LevelMove;
use crate::core::explanation::Explanation;
use crate::core::outcome::{GroupOutcome, learnability};
use crate::core::proposal::{Proposal, ProposalRole, ScenarioSource};
use crate::core::sampler_state::SamplerOutlook;
use crate::core::settings::hyperparameters::learnability::{
    AMONG, CANDIDATES, KEPT, RANK, ROLLOUTS, RankingMethod, SHARE,
};
use crate::core::settings::{Settings, TaskPlan};
use crate::core::shares;
use crate::core::strategy::{Strategy, StrategyContext, StrategyState, drop_stale_tasks};

/// State of the learnability strategy: one pool of scenarios for each task.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Learnability {
    tasks: BTreeMap<String, ScenarioPool>,
}

/// Scenarios of a task: those under trial, and those kept.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct ScenarioPool {
    /// Scenarios with too few episodes, by the seq of the proposal that made them.
    trials: BTreeMap<u64, Trial>,
    /// Those of them that wait for another group, first in first out.
    repeat_queue: VecDeque<u64>,
    /// Rated candidates since the last refill, best first; no more than may be kept.
    best: Vec<RatedScenario>,
    /// Number of candidates rated since the last refill.
    rated: u32,
    /// Scenarios that are repeated until the next refill, best first.
    kept: Vec<RatedScenario>,
    /// Number of times that `kept` was replaced.
    refills: u32,
    model: SuccessModel,
}

/// Candidate with too few episodes to be rated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Trial {
    level: Option<u32>,
    episodes: u32,
    successes: u32,
}

/// Candidate whose learnability is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct RatedScenario {
    /// Seq of the proposal that made the scenario.
    seq: u64,
    level: Option<u32>,
    learnability: f64,
}

/// Ranking method that the settings select.
fn ranking_method(settings: &Settings) -> RankingMethod {
    RankingMethod::from_name(settings.hyperparameters.choice(&RANK))
}

impl Strategy for Learnability {
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal {
        let mut rng = ctx.rng();
        let plan = shares::pick_task(ctx.settings, rng.uniform());
        self.tasks.entry(plan.task.clone()).or_default().propose(ctx.settings, plan, &mut rng)
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        if let Some(plan) = ctx.settings.task(&outcome.task) {
            let pool = self.tasks.entry(outcome.task.clone()).or_default();
            if outcome.usable && outcome.finished > 0 {
                pool.observe(ctx.settings, plan, outcome);
            } else if outcome.role == ProposalRole::Explore {
                pool.drop_trial(outcome);
            }
        }
        Vec::new()
    }

    fn change_settings(&mut self, restarted: &[&str], ctx: &StrategyContext<'_>) {
        drop_stale_tasks(&mut self.tasks, restarted, ctx);
        let capacity = ctx.settings.hyperparameters.integer(&KEPT) as usize;
        for pool in self.tasks.values_mut() {
            pool.kept.truncate(capacity);
            pool.best.truncate(capacity);
        }
    }

    fn retained_proposals(&self) -> Vec<u64> {
        let of_pool = |pool: &ScenarioPool| -> Vec<u64> {
            let rated = pool.kept.iter().chain(&pool.best).map(|scenario| scenario.seq);
            pool.trials.keys().copied().chain(rated).collect()
        };
        self.tasks.values().flat_map(of_pool).collect()
    }

    fn sampler(&self, plan: &TaskPlan, ctx: &StrategyContext<'_>) -> SamplerOutlook {
        let empty = ScenarioPool::default();
        let pool = self.tasks.get(&plan.task).unwrap_or(&empty);
        SamplerOutlook::with_level_probabilities(outlook::level_probabilities(pool, ctx.settings, plan))
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        explain::explain(self, settings)
    }
}

impl StrategyState for Learnability {
    const VERSION: u32 = 1;

    fn new(_settings: &Settings) -> Self {
        Self::default()
    }
}

impl ScenarioPool {
    fn propose(&mut self, settings: &Settings, plan: &TaskPlan, rng: &mut KeyedRng) -> Proposal {
        let contested = rng.bernoulli(settings.contested_share);
        let use_ranking = rng.bernoulli(settings.hyperparameters.number(&SHARE));
        if ranking_method(settings) == RankingMethod::Model {
            let among = settings.hyperparameters.integer(&AMONG);
            return match use_ranking.then(|| self.model.choose(plan, among, rng)).flatten() {
                Some(proposal) => Proposal { contested, ..proposal },
                None => explore(plan, contested, rng),
            };
        }
        if use_ranking && !self.kept.is_empty() {
            let index = rng.below(u32::try_from(self.kept.len()).unwrap_or(u32::MAX)) as usize;
            return replay(plan, &self.kept[index]);
        }
        match self.repeat_queue.pop_front().and_then(|of| Some((of, self.trials.get(&of)?))) {
            Some((of, trial)) => {
                let why = format!(
                    "the scenario of proposal {of} again: {} of {} episodes are in",
                    trial.episodes,
                    settings.hyperparameters.integer(&ROLLOUTS)
                );
                let source = ScenarioSource::Replay { of };
                Proposal { source, why, ..Proposal::fresh(plan, trial.level, ProposalRole::Explore) }
            }
            None => explore(plan, contested, rng),
        }
    }

    /// Records an outcome: in the model, or in the trial of its scenario.
    fn observe(&mut self, settings: &Settings, plan: &TaskPlan, outcome: &GroupOutcome) {
        if ranking_method(settings) == RankingMethod::Model {
            self.model.observe(plan, outcome);
            return;
        }
        if outcome.role != ProposalRole::Explore {
            return;
        }
        let seq = outcome.scenario_proposal();
        let untried = Trial { level: outcome.level, episodes: 0, successes: 0 };
        let trial = self.trials.entry(seq).or_insert(untried);
        trial.episodes = trial.episodes.saturating_add(outcome.finished);
        trial.successes = trial.successes.saturating_add(outcome.successes.min(outcome.finished));
        if trial.episodes < settings.hyperparameters.integer(&ROLLOUTS) {
            self.repeat_queue.push_back(seq);
            return;
        }
        let Trial { level, episodes, successes } = *trial;
        self.trials.remove(&seq);
        let learnability = learnability(successes, episodes).unwrap_or(0.0);
        self.rate(settings, RatedScenario { seq, level, learnability });
    }

    /// Adds a rated candidate. After the last candidate, the best replace the kept scenarios.
    fn rate(&mut self, settings: &Settings, scenario: RatedScenario) {
        self.rated = self.rated.saturating_add(1);
        if scenario.learnability > 0.0 {
            let at = self.best.partition_point(|other| other.learnability >= scenario.learnability);
            self.best.insert(at, scenario);
            self.best.truncate(settings.hyperparameters.integer(&KEPT) as usize);
        }
        if self.rated >= settings.hyperparameters.integer(&CANDIDATES) {
            // If no candidate is learnable, neither are the scenarios kept before: only fresh ones remain.
            self.kept = std::mem::take(&mut self.best);
            self.rated = 0;
            self.refills = self.refills.saturating_add(1);
        }
    }

    /// Ends the trial of a scenario whose whole group was lost.
    fn drop_trial(&mut self, outcome: &GroupOutcome) {
        self.trials.remove(&outcome.scenario_proposal());
    }
}

/// Proposes a fresh scenario as a candidate.
fn explore(plan: &TaskPlan, contested: bool, rng: &mut KeyedRng) -> Proposal {
    let level = rng.below(plan.hardest_level() + 1);
    let why = format!("level {level}, drawn uniformly, to see how often it succeeds");
    Proposal { contested, why, ..Proposal::fresh(plan, Some(level), ProposalRole::Explore) }
}

/// Proposes a kept scenario again.
fn replay(plan: &TaskPlan, scenario: &RatedScenario) -> Proposal {
    let RatedScenario { seq: of, level, learnability } = *scenario;
    let why = format!("the scenario of proposal {of} again: its learnability is {learnability:.2}");
    let source = ScenarioSource::Replay { of };
    Proposal { source, why, ..Proposal::fresh(plan, level, ProposalRole::Replay) }
}
