//! Level bandit: rungs are drawn by p(1 − p) of their success rate p, which is largest where the agent learns most.
//!
//! Each rung has a Beta posterior over its success rate that forgets, because the agent changes (Raj and Kalyani 2017, "Taming
//! non-stationary bandits").

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use super::{ChosenRung, RungResult, Sampler, SamplerSetting};
use crate::core::evidence::posterior::mean_variance;
use crate::core::settings::hyperparameters::bandit::{FORGET, UNIFORM};
use crate::core::settings::{Hyperparameters, TaskPlan};

/// Success of each rung so far. A rung without an entry has no result.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::strategies) struct Bandit {
    rungs: Vec<RungSuccess>,
}

/// Latest results of a rung: numbers of successes and failures, which fade.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct RungSuccess {
    successes: f64,
    failures: f64,
}

impl RungSuccess {
    /// Mean of p(1 − p) under the posterior Beta(1 + successes, 1 + failures).
    fn weight(&self) -> f64 {
        mean_variance(1.0 + self.successes, 1.0 + self.failures)
    }
}

impl Sampler for Bandit {
    const VERSION: u32 = 1;
    const SUMMARY: &'static str = "Rungs are drawn by p(1 − p) of their success rate p: those that succeed about half of the time most.";

    fn new(_: &TaskPlan) -> Self {
        Self::default()
    }

    /// The uniform share of the draws covers all rungs, and its results count.
    fn coverage(&self, _: &Hyperparameters) -> f64 {
        0.0
    }

    fn choose(&self, setting: &SamplerSetting<'_>, rng: &mut KeyedRng) -> ChosenRung {
        let count = setting.rungs.len();
        if rng.bernoulli(setting.hyperparameters.number(&UNIFORM)) {
            return ChosenRung { rung: rng.below(count), chain: None, why: "drawn uniformly".to_owned() };
        }
        let weights: Vec<f64> = (0..count).map(|rung| self.rung(rung).weight()).collect();
        let rung = rng.weighted_index(&weights).and_then(|rung| u32::try_from(rung).ok()).unwrap_or(0);
        ChosenRung { rung, chain: None, why: format!("its p(1 − p) is {:.2}", self.rung(rung).weight()) }
    }

    fn observe(&mut self, result: &RungResult, setting: &SamplerSetting<'_>, _: KeyedRng) {
        let rung = result.rung as usize;
        if self.rungs.len() <= rung {
            self.rungs.resize(rung + 1, RungSuccess::default());
        }
        let episodes = f64::from(result.successes + result.failures);
        let kept = libm::pow(1.0 - setting.hyperparameters.number(&FORGET), episodes);
        let RungSuccess { successes, failures } = &mut self.rungs[rung];
        *successes = *successes * kept + f64::from(result.successes);
        *failures = *failures * kept + f64::from(result.failures);
    }

    fn describe(&self, _: &TaskPlan, setting: &SamplerSetting<'_>) -> String {
        let best =
            (0..setting.rungs.len()).max_by(|a, b| self.rung(*a).weight().total_cmp(&self.rung(*b).weight()));
        best.filter(|_| !self.rungs.is_empty()).map_or_else(
            || "no rung has a result yet".to_owned(),
            |best| format!("rung {best} has the largest p(1 − p): {:.2}", self.rung(best).weight()),
        )
    }
}

impl Bandit {
    fn rung(&self, rung: u32) -> RungSuccess {
        self.rungs.get(rung as usize).copied().unwrap_or_default()
    }
}
