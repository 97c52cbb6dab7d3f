//! Staircase: interleaved up-and-down staircases.
//!
//! Many chains climb the rungs independently of each other. A success moves a chain up by a fraction of a rung and a failure moves
//! it down by as much, so each chain settles where half of the episodes succeed (Levitt 1971, *J. Acoust. Soc. Am.* 49, 467–477;
//! Cornsweet 1962 interleaves them). A chain that climbs past the top goes on at a random rung, so that an agent that has
//! learnt all rungs meets all of them.
//!
//! Chains have equal shares of the *steps*, not of the episodes: a chain at a rung with long episodes is drawn less often. Otherwise
//! the highest chains would take most of the steps.

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use super::episode_length::EpisodeLength;
use super::{ChosenRung, RungResult, Sampler, SamplerSetting};
use crate::core::probabilities::normalize;
use crate::core::settings::hyperparameters::staircase::{CHAINS, COVERAGE, STEP};
use crate::core::settings::{Hyperparameters, TaskPlan};

/// Positions of the chains on the rungs, and lengths of the episodes of each rung. A chain without an entry is at 0.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::strategies) struct Staircase {
    positions: Vec<f64>,
    lengths: Vec<EpisodeLength>,
}

impl Sampler for Staircase {
    const VERSION: u32 = 2;
    const SUMMARY: &'static str =
        "Chains climb a fraction of a rung after each success and fall as much after each failure.";

    fn new(_: &TaskPlan) -> Self {
        Self::default()
    }

    fn coverage(&self, hyperparameters: &Hyperparameters) -> f64 {
        hyperparameters.number(&COVERAGE)
    }

    fn choose(&self, setting: &SamplerSetting<'_>, rng: &mut KeyedRng) -> ChosenRung {
        let weights: Vec<f64> = self.chain_weights(setting).map(|chain| chain.weight).collect();
        let chain = rng.weighted_index(&weights).and_then(|chain| u32::try_from(chain).ok()).unwrap_or(0);
        let why = format!("chain {chain} is at {:.2}", self.position(chain));
        ChosenRung { rung: self.rung_of(chain, setting), chain: Some(chain), why }
    }

    fn observe(&mut self, result: &RungResult, setting: &SamplerSetting<'_>, mut rng: KeyedRng) {
        let rung = result.rung as usize;
        if self.lengths.len() <= rung {
            self.lengths.resize(rung + 1, EpisodeLength::default());
        }
        self.lengths[rung].add(result.steps, result.successes + result.failures);
        // The number of chains may have changed since.
        let Some(chain) = result.chain.filter(|chain| *chain < setting.hyperparameters.integer(&CHAINS))
        else {
            return;
        };
        let chain = chain as usize;
        if self.positions.len() <= chain {
            self.positions.resize(chain + 1, 0.0);
        }
        let step = setting.hyperparameters.number(&STEP);
        let change = step * (f64::from(result.successes) - f64::from(result.failures));
        let position = (self.positions[chain] + change).max(0.0);
        let is_past_top = position >= f64::from(setting.rungs.len());
        self.positions[chain] =
            if is_past_top { f64::from(rng.below(setting.rungs.len())) } else { position };
    }

    fn probabilities(&self, setting: &SamplerSetting<'_>) -> Option<Vec<f64>> {
        let mut weights = vec![0.0; setting.rungs.len() as usize];
        for ChainWeight { rung, weight } in self.chain_weights(setting) {
            weights[rung as usize] += weight;
        }
        Some(normalize(&weights))
    }

    fn chains(&self, setting: &SamplerSetting<'_>) -> Option<Vec<u32>> {
        let mut chains = vec![0; setting.rungs.len() as usize];
        for ChainWeight { rung, .. } in self.chain_weights(setting) {
            chains[rung as usize] += 1;
        }
        Some(chains)
    }

    fn describe(&self, _: &TaskPlan, setting: &SamplerSetting<'_>) -> String {
        let chains = setting.hyperparameters.integer(&CHAINS);
        match self.quartiles(setting) {
            None => format!("all {chains} chains are at the easiest rung"),
            Some([lower, median, upper]) => format!(
                "half of the {chains} chains are between {lower:.1} and {upper:.1} of {}, their median is {median:.1}",
                setting.rungs.top()
            ),
        }
    }

    fn quartiles(&self, setting: &SamplerSetting<'_>) -> Option<[f64; 3]> {
        let chains = setting.hyperparameters.integer(&CHAINS) as usize;
        let mut positions: Vec<f64> =
            (0..chains).map(|chain| self.positions.get(chain).copied().unwrap_or(0.0)).collect();
        positions.sort_by(f64::total_cmp);
        let at = |quarters: usize| positions.get(quarters * (chains - 1) / 4).copied();
        self.positions.iter().any(|position| *position > 0.0).then_some([at(1)?, at(2)?, at(3)?])
    }
}

/// Rung of a chain, and the weight with which the chain is drawn.
struct ChainWeight {
    rung: u32,
    weight: f64,
}

impl Staircase {
    /// Rungs and weights of all chains. The weight is the inverse of the length of the rung's episodes.
    fn chain_weights(&self, setting: &SamplerSetting<'_>) -> impl Iterator<Item = ChainWeight> {
        let lengths = self.lengths(setting.rungs.top());
        (0..setting.hyperparameters.integer(&CHAINS)).map(move |chain| {
            let rung = self.rung_of(chain, setting);
            ChainWeight { rung, weight: 1.0 / lengths[rung as usize] }
        })
    }

    fn rung_of(&self, chain: u32, setting: &SamplerSetting<'_>) -> u32 {
        floor(self.position(chain)).min(setting.rungs.top())
    }

    fn position(&self, chain: u32) -> f64 {
        self.positions.get(chain as usize).copied().unwrap_or(0.0)
    }

    /// Mean length of the episodes of each rung. A rung without episodes has the length of the one below it.
    fn lengths(&self, top: u32) -> Vec<f64> {
        let mut last = 1.0;
        (0..=top as usize)
            .map(|rung| {
                last = self.lengths.get(rung).and_then(EpisodeLength::mean).unwrap_or(last);
                last
            })
            .collect()
    }
}

/// Largest whole number up to a position, which is not negative.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "positions are from 0 to the number of rungs"
)]
fn floor(position: f64) -> u32 {
    position as u32
}
