//! Level bandit: rungs are drawn by p(1 − p) of their success rate p, which is largest where the agent learns most.
//!
//! Each rung has a Beta posterior over its success rate that forgets, because the agent changes (Raj and Kalyani 2017, "Taming
//! non-stationary bandits").

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use super::{ChosenRung, RungResult, Sampler, SamplerSetting};
use crate::core::decayed_success::DecayedSuccess;
use crate::core::evidence::posterior::mean_variance;
use crate::core::probabilities::{mix, normalize, uniform_probabilities};
use crate::core::settings::hyperparameters::bandit::{FORGET, UNIFORM};
use crate::core::settings::{Hyperparameters, TaskPlan};

/// Success of each rung so far. A rung without an entry has no result.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::strategies) struct Bandit {
    rungs: Vec<DecayedSuccess>,
}

/// Mean of p(1 − p) under the posterior Beta(1 + successes, 1 + failures).
fn weight(success: &DecayedSuccess) -> f64 {
    mean_variance(1.0 + success.successes, 1.0 + success.failures)
}

impl Sampler for Bandit {
    const VERSION: u32 = 2;
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
        let rung =
            rng.weighted_index(&self.weights(count)).and_then(|rung| u32::try_from(rung).ok()).unwrap_or(0);
        ChosenRung { rung, chain: None, why: format!("its p(1 − p) is {:.2}", weight(&self.rung(rung))) }
    }

    fn observe(&mut self, result: &RungResult, setting: &SamplerSetting<'_>, _: KeyedRng) {
        let rung = result.rung as usize;
        if self.rungs.len() <= rung {
            self.rungs.resize(rung + 1, DecayedSuccess::default());
        }
        let forget = setting.hyperparameters.number(&FORGET);
        self.rungs[rung].add(result.successes, result.failures, forget);
    }

    fn probabilities(&self, setting: &SamplerSetting<'_>) -> Option<Vec<f64>> {
        let count = setting.rungs.len();
        let uniform = setting.hyperparameters.number(&UNIFORM);
        Some(mix(uniform, &uniform_probabilities(count), &normalize(&self.weights(count))))
    }

    fn describe(&self, _: &TaskPlan, setting: &SamplerSetting<'_>) -> String {
        let best =
            (0..setting.rungs.len()).max_by(|a, b| weight(&self.rung(*a)).total_cmp(&weight(&self.rung(*b))));
        best.filter(|_| !self.rungs.is_empty()).map_or_else(
            || "no rung has a result yet".to_owned(),
            |best| format!("rung {best} has the largest p(1 − p): {:.2}", weight(&self.rung(best))),
        )
    }
}

impl Bandit {
    fn weights(&self, count: u32) -> Vec<f64> {
        (0..count).map(|rung| weight(&self.rung(rung))).collect()
    }

    fn rung(&self, rung: u32) -> DecayedSuccess {
        self.rungs.get(rung as usize).copied().unwrap_or_default()
    }
}
