//! Learnability: scenarios on which the agent succeeds now and then, neither always nor never.
//!
//! Sampling for learnability (Rutherford et al. 2024): of N fresh scenarios, each flown L times, those with the highest
//! k(L − k)/(L(L − 1)) are kept until the next N are through; half of what is faced comes from them, half is fresh. The fresh half
//! are the candidates here: a service has no rollouts to spare, and what is flown may as well be learnt from.
//!
//! The estimate is of the rollouts themselves. p(1 − p) of a posterior's mean would rank first what was never seen.
//!
//! Where even the candidates' rollouts cost too much (`rank: model`), nothing is faced twice: a logistic model ([`model`]) over params
//! and the panel's success says which of some fresh scenarios is nearest one half, and half of what is faced is chosen by it.

mod model;
mod words;

use std::collections::{BTreeMap, VecDeque};

use env_core::Draws;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use self::model::Model;
use super::event::{GroupOutcome, Move, Proposal, Role, Source, learnability};
use super::explain::{Explanation, TaskStatus};
use super::settings::{Settings, TaskPlan};
use super::shares;
use super::strategy::{Context, Strategy};
use super::tuning::{Hyper, Range};

const VERSION: u32 = 1;

pub(super) const RANK: Hyper = Hyper {
    name: "rank",
    range: Range::Word(&["rollouts", "model"]),
    about: "what ranks scenarios: rollouts of each, or a logistic model over params and the blind panel's success",
    source: "Rutherford et al. 2024; ours where rollouts cost calls of a language model",
};
pub(super) const CANDIDATES: Hyper = Hyper {
    name: "candidates",
    range: Range::Whole { default: 256, min: 2, max: 100_000 },
    about: "fresh scenarios of a task, N, after which those kept are replaced",
    source: "Rutherford et al. 2024 have 5 000, in a simulator of its own",
};
pub(super) const ROLLOUTS: Hyper = Hyper {
    name: "rollouts",
    range: Range::Whole { default: 8, min: 2, max: 1024 },
    about: "episodes of each candidate, L: groups of fewer are faced again until there are as many",
    source: "Rutherford et al. 2024 have some tens; a group of GRPO has 8",
};
pub(super) const KEPT: Hyper = Hyper {
    name: "kept",
    range: Range::Whole { default: 64, min: 1, max: 10_000 },
    about: "scenarios of a task that are kept of the candidates",
    source: "Rutherford et al. 2024 keep one in five",
};
pub(super) const SHARE: Hyper = Hyper {
    name: "share",
    range: Range::Number { default: 0.5, min: 0.0, max: 1.0 },
    about: "share of what is faced that comes from those kept, or is chosen by the model",
    source: "Rutherford et al. 2024, ρ",
};
pub(super) const AMONG: Hyper = Hyper {
    name: "among",
    range: Range::Whole { default: 8, min: 1, max: 64 },
    about: "scenarios drawn of which the model chooses one",
    source: "ours: each takes a bracket, 0.5 to 5 ms",
};

pub(super) const HYPERS: &[Hyper] = &[RANK, CANDIDATES, ROLLOUTS, KEPT, SHARE, AMONG];

/// What is known of each task.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Learnability {
    tasks: BTreeMap<String, Pool>,
}

/// A scenario under trial.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Candidate {
    level: Option<u32>,
    episodes: u32,
    successes: u32,
}

/// A scenario that was tried.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Tried {
    /// The seq of the proposal that made it.
    seq: u64,
    level: Option<u32>,
    learnability: f64,
}

/// What is known of a task.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Pool {
    /// Those flown too seldom yet, by the seq of the proposal that made them.
    trials: BTreeMap<u64, Candidate>,
    /// Of these, those to be flown again, the first first.
    again: VecDeque<u64>,
    /// Those tried since the last change of what is kept, the best first; no more than may be kept.
    best: Vec<Tried>,
    /// How many were tried since then.
    tried: u32,
    kept: Vec<Tried>,
    /// How often what is kept was replaced.
    refills: u32,
    model: Model,
}

impl Learnability {
    pub(super) fn restore(state: &Value) -> Result<Self, serde_json::Error> {
        Self::deserialize(state)
    }
}

pub(super) fn by_model(settings: &Settings) -> bool {
    settings.tuning.word(&RANK) == "model"
}

impl Pool {
    fn propose(&mut self, settings: &Settings, plan: &TaskPlan, draws: &mut Draws) -> Proposal {
        let contested = draws.chance(settings.contested_share);
        let ranked = draws.chance(settings.tuning.number(&SHARE));
        if by_model(settings) {
            return match ranked
                .then(|| self.model.choose(plan, settings.tuning.whole(&AMONG), draws))
                .flatten()
            {
                Some(proposal) => Proposal { contested, ..proposal },
                None => Self::fresh(plan, contested, draws),
            };
        }
        if ranked && !self.kept.is_empty() {
            let place = draws.below(u32::try_from(self.kept.len()).unwrap_or(u32::MAX)) as usize;
            let Tried { seq: of, level, learnability } = self.kept[place];
            let why = format!("the scenario of proposal {of} again: its learnability is {learnability:.2}");
            let source = Source::Again { of };
            return Proposal { source, why, ..Proposal::at(plan, level, Role::Replay) };
        }
        match self.again.pop_front().and_then(|of| Some((of, self.trials.get(&of)?))) {
            Some((of, trial)) => {
                let why = format!(
                    "the scenario of proposal {of} again: {} of {} episodes are in",
                    trial.episodes,
                    settings.tuning.whole(&ROLLOUTS)
                );
                Proposal {
                    source: Source::Again { of },
                    why,
                    ..Proposal::at(plan, trial.level, Role::Explore)
                }
            }
            None => Self::fresh(plan, contested, draws),
        }
    }

    fn fresh(plan: &TaskPlan, contested: bool, draws: &mut Draws) -> Proposal {
        let level = draws.below(plan.top() + 1);
        let why = format!("level {level}, drawn uniformly, to see how often it succeeds");
        Proposal { contested, why, ..Proposal::at(plan, Some(level), Role::Explore) }
    }

    fn observe(&mut self, settings: &Settings, plan: &TaskPlan, outcome: &GroupOutcome) {
        if by_model(settings) {
            self.model.observe(plan, outcome);
            return;
        }
        if outcome.role != Role::Explore {
            return;
        }
        let seq = outcome.made_by();
        let blank = Candidate { level: outcome.level, episodes: 0, successes: 0 };
        let trial = self.trials.entry(seq).or_insert(blank);
        trial.episodes = trial.episodes.saturating_add(outcome.finished);
        trial.successes = trial.successes.saturating_add(outcome.successes.min(outcome.finished));
        if trial.episodes < settings.tuning.whole(&ROLLOUTS) {
            self.again.push_back(seq);
            return;
        }
        let Candidate { level, episodes, successes } = *trial;
        self.trials.remove(&seq);
        self.rank(
            settings,
            Tried { seq, level, learnability: learnability(successes, episodes).unwrap_or(0.0) },
        );
    }

    /// Takes one that was tried; after the last candidate what is kept is replaced.
    fn rank(&mut self, settings: &Settings, tried: Tried) {
        self.tried += 1;
        if tried.learnability > 0.0 {
            let at = self.best.partition_point(|other| other.learnability >= tried.learnability);
            self.best.insert(at, tried);
            self.best.truncate(settings.tuning.whole(&KEPT) as usize);
        }
        if self.tried >= settings.tuning.whole(&CANDIDATES) {
            // Where none is learnable, those before are not either: only fresh ones are left.
            self.kept = std::mem::take(&mut self.best);
            self.tried = 0;
            self.refills = self.refills.saturating_add(1);
        }
    }

    /// A trial whose proposal was lost as a whole is over.
    fn forget(&mut self, outcome: &GroupOutcome) {
        self.trials.remove(&outcome.made_by());
    }
}

impl Strategy for Learnability {
    fn propose(&mut self, ctx: &Context<'_>) -> Proposal {
        let mut draws = ctx.draws();
        let plan = shares::pick(ctx.settings, draws.uniform());
        self.tasks.entry(plan.task.clone()).or_default().propose(ctx.settings, plan, &mut draws)
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &Context<'_>) -> Vec<Move> {
        if let Some(plan) = ctx.settings.task(&outcome.task) {
            let pool = self.tasks.entry(outcome.task.clone()).or_default();
            if outcome.evidence && outcome.finished > 0 {
                pool.observe(ctx.settings, plan, outcome);
            } else if outcome.role == Role::Explore {
                pool.forget(outcome);
            }
        }
        Vec::new()
    }

    fn adopt(&mut self, afresh: &[&str], ctx: &Context<'_>) {
        self.tasks.retain(|task, _| ctx.settings.task(task).is_some() && !afresh.contains(&task.as_str()));
        for pool in self.tasks.values_mut() {
            pool.kept.truncate(ctx.settings.tuning.whole(&KEPT) as usize);
            pool.best.truncate(ctx.settings.tuning.whole(&KEPT) as usize);
        }
    }

    fn held(&self) -> Vec<u64> {
        let of = |pool: &Pool| -> Vec<u64> {
            let tried = pool.kept.iter().chain(&pool.best).map(|tried| tried.seq);
            pool.trials.keys().copied().chain(tried).collect()
        };
        self.tasks.values().flat_map(of).collect()
    }

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        words::status(settings)
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        words::explain(self, settings)
    }

    fn snapshot(&self) -> Value {
        serde_json::to_value(self).expect("a state of finite numbers and string keys has a JSON form")
    }

    fn version(&self) -> u32 {
        VERSION
    }

    fn boxed_clone(&self) -> Box<dyn Strategy> {
        Box::new(self.clone())
    }
}
