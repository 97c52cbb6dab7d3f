//! Strategy `auto`: the sampler of each task that a table of trials names.

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use super::{Bandit, ChosenRung, RungResult, Sampler, SamplerSetting, Staircase};
use crate::core::probabilities::uniform_probabilities;
use crate::core::rungs::RungScale;
use crate::core::sampler_state::SamplerChoice;
use crate::core::settings::{Hyperparameters, TaskPlan};

/// Sampler that the table names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SamplerName {
    Staircase,
    Bandit,
    Uniform,
}

/// Sampler of a task, with its reason as the end of a sentence.
struct TaskChoice {
    task: &'static str,
    sampler: SamplerName,
    reason: &'static str,
}

/// Choices by trainings with tuning seeds, one or two of each sampler and task. The evidence protocol has other seeds.
const CHOICES: [TaskChoice; 9] = [
    TaskChoice {
        task: "docking/single",
        sampler: SamplerName::Staircase,
        reason: "it needed a third of the steps of uniform levels with tuning seeds",
    },
    TaskChoice {
        task: "docking/multiagent",
        sampler: SamplerName::Bandit,
        reason: "it needed fewer steps than uniform levels with tuning seeds, and the staircase more",
    },
    TaskChoice {
        task: "kessler/survival",
        sampler: SamplerName::Staircase,
        reason: "it needed half of the steps of uniform levels with tuning seeds",
    },
    TaskChoice {
        task: "kessler/rendezvous",
        sampler: SamplerName::Uniform,
        reason: "the staircase stayed at the nearest starts with tuning seeds",
    },
    TaskChoice {
        task: "kessler/eco_station",
        sampler: SamplerName::Uniform,
        reason: "no sampler was better than uniform levels with tuning seeds",
    },
    TaskChoice {
        task: "kessler/formation",
        sampler: SamplerName::Uniform,
        reason: "no sampler was better than uniform levels with tuning seeds",
    },
    TaskChoice {
        task: "tasking/scanning",
        sampler: SamplerName::Bandit,
        reason: "it needed two thirds of the steps of uniform levels with tuning seeds",
    },
    TaskChoice { task: "tasking/imaging", sampler: SamplerName::Uniform, reason: UNTRIED },
    TaskChoice { task: "tasking/constellation", sampler: SamplerName::Uniform, reason: UNTRIED },
];
/// Reason of a choice without trials.
const UNTRIED: &str = "no sampler was tried on its start rungs";

/// Sampler of a task, as it was chosen when the task began.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(in crate::strategies) enum Auto {
    /// Chains that climb the rungs.
    Staircase(Staircase),
    /// Rungs are drawn by p(1 − p) of their success rate p.
    Bandit(Bandit),
    /// Levels are drawn uniformly, at full starts.
    Uniform,
}

/// The choice for a task under a plan: the sampler, and its reason.
fn choose_sampler(plan: &TaskPlan) -> (SamplerName, &'static str) {
    let rungs = RungScale::new(plan);
    match CHOICES.iter().find(|choice| choice.task == plan.task) {
        Some(choice) => (choice.sampler, choice.reason),
        None if rungs.are_starts() => {
            (SamplerName::Staircase, "the task was not tried, and it has start rungs")
        }
        None => (SamplerName::Uniform, "the task was not tried, and it has no start rungs"),
    }
}

impl Sampler for Auto {
    const VERSION: u32 = 2;
    const SUMMARY: &'static str = "Each task has the sampler that a table names for it.";

    fn new(plan: &TaskPlan) -> Self {
        match choose_sampler(plan).0 {
            SamplerName::Staircase => Self::Staircase(Staircase::new(plan)),
            SamplerName::Bandit => Self::Bandit(Bandit::new(plan)),
            SamplerName::Uniform => Self::Uniform,
        }
    }

    fn coverage(&self, hyperparameters: &Hyperparameters) -> f64 {
        match self {
            Self::Staircase(sampler) => sampler.coverage(hyperparameters),
            Self::Bandit(sampler) => sampler.coverage(hyperparameters),
            Self::Uniform => 0.0,
        }
    }

    fn choose(&self, setting: &SamplerSetting<'_>, rng: &mut KeyedRng) -> ChosenRung {
        let chain = None;
        match self {
            Self::Staircase(sampler) => sampler.choose(setting, rng),
            Self::Bandit(sampler) => sampler.choose(setting, rng),
            Self::Uniform if setting.rungs.are_starts() => {
                ChosenRung { rung: setting.rungs.top(), chain, why: "a level drawn uniformly".to_owned() }
            }
            Self::Uniform => {
                ChosenRung { rung: rng.below(setting.rungs.len()), chain, why: "drawn uniformly".to_owned() }
            }
        }
    }

    fn observe(&mut self, result: &RungResult, setting: &SamplerSetting<'_>, rng: KeyedRng) {
        match self {
            Self::Staircase(sampler) => sampler.observe(result, setting, rng),
            Self::Bandit(sampler) => sampler.observe(result, setting, rng),
            Self::Uniform => {}
        }
    }

    fn is_contested(&self, setting: &SamplerSetting<'_>) -> bool {
        match self {
            Self::Staircase(sampler) => sampler.is_contested(setting),
            Self::Bandit(sampler) => sampler.is_contested(setting),
            Self::Uniform => false,
        }
    }

    fn probabilities(&self, setting: &SamplerSetting<'_>) -> Option<Vec<f64>> {
        match self {
            Self::Staircase(sampler) => sampler.probabilities(setting),
            Self::Bandit(sampler) => sampler.probabilities(setting),
            Self::Uniform if setting.rungs.are_starts() => None,
            Self::Uniform => Some(uniform_probabilities(setting.rungs.len())),
        }
    }

    fn chains(&self, setting: &SamplerSetting<'_>) -> Option<Vec<u32>> {
        match self {
            Self::Staircase(sampler) => sampler.chains(setting),
            Self::Bandit(sampler) => sampler.chains(setting),
            Self::Uniform => None,
        }
    }

    fn describe(&self, plan: &TaskPlan, setting: &SamplerSetting<'_>) -> String {
        match self {
            Self::Staircase(sampler) => sampler.describe(plan, setting),
            Self::Bandit(sampler) => sampler.describe(plan, setting),
            Self::Uniform => "levels are drawn uniformly".to_owned(),
        }
    }

    fn choice(&self, plan: &TaskPlan) -> Option<SamplerChoice> {
        let name = match self {
            Self::Staircase(_) => "staircase",
            Self::Bandit(_) => "bandit",
            Self::Uniform => "uniform",
        };
        Some(SamplerChoice { name, reason: choose_sampler(plan).1 })
    }

    fn quartiles(&self, setting: &SamplerSetting<'_>) -> Option<[f64; 3]> {
        match self {
            Self::Staircase(sampler) => sampler.quartiles(setting),
            Self::Bandit(sampler) => sampler.quartiles(setting),
            Self::Uniform => None,
        }
    }
}
