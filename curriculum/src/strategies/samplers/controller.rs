//! Controller: one position for a task, moved towards a success rate of one half (AdaRFT; Shi et al. 2025, "Efficient
//! Reinforcement Finetuning via Adaptive Curriculum Learning", section 3).

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use super::{ChosenRung, RungResult, Sampler, SamplerSetting};
use crate::core::settings::hyperparameters::controller::{COVERAGE, RATE, WIDTH};
use crate::core::settings::{Hyperparameters, TaskPlan};

/// Slope of the reaction to a success rate off one half.
const SENSITIVITY: f64 = 2.0;

/// Position of the task on its rungs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::strategies) struct Controller {
    position: f64,
}

impl Sampler for Controller {
    const VERSION: u32 = 2;
    const SUMMARY: &'static str = "The task's position on its rungs follows a success rate of one half.";

    fn new(_: &TaskPlan) -> Self {
        Self::default()
    }

    fn coverage(&self, hyperparameters: &Hyperparameters) -> f64 {
        hyperparameters.number(&COVERAGE)
    }

    fn choose(&self, setting: &SamplerSetting<'_>, rng: &mut KeyedRng) -> ChosenRung {
        let width = setting.hyperparameters.number(&WIDTH);
        let target = self.position + width * (2.0 * rng.uniform() - 1.0);
        let why = format!("the position is {:.2}", self.position);
        ChosenRung { rung: nearest_rung(target, setting.rungs.top()), chain: None, why }
    }

    /// Moves by rate · tanh(2(s − ½)) for each episode of a group with the success rate s. Results far from the position, which
    /// were proposed long ago, do not move it.
    fn observe(&mut self, result: &RungResult, setting: &SamplerSetting<'_>, _: KeyedRng) {
        let hyperparameters = setting.hyperparameters;
        // Half a rung more, because the target is rounded to a rung.
        if (f64::from(result.rung) - self.position).abs() > hyperparameters.number(&WIDTH) + 0.5 {
            return;
        }
        let episodes = f64::from(result.successes + result.failures);
        let success = f64::from(result.successes) / episodes;
        let change = hyperparameters.number(&RATE) * episodes * libm::tanh(SENSITIVITY * (success - 0.5));
        self.position = (self.position + change).clamp(0.0, f64::from(setting.rungs.top()));
    }

    /// Shares of the width around the position at which each rung is the nearest one.
    fn probabilities(&self, setting: &SamplerSetting<'_>) -> Option<Vec<f64>> {
        let (width, top) = (setting.hyperparameters.number(&WIDTH), setting.rungs.top());
        let at_position = nearest_rung(self.position, top);
        let probability = |rung: u32| {
            if width == 0.0 {
                return f64::from(u8::from(rung == at_position));
            }
            let (low, high) = (self.position - width, self.position + width);
            let from = if rung == 0 { low } else { f64::from(rung) - 0.5 };
            let to = if rung == top { high } else { f64::from(rung) + 0.5 };
            (to.min(high) - from.max(low)).max(0.0) / (2.0 * width)
        };
        Some((0..=top).map(probability).collect())
    }

    fn describe(&self, _: &TaskPlan, setting: &SamplerSetting<'_>) -> String {
        format!("the position is {:.2} of {}", self.position, setting.rungs.top())
    }

    fn quartiles(&self, setting: &SamplerSetting<'_>) -> Option<[f64; 3]> {
        let half = setting.hyperparameters.number(&WIDTH) / 2.0;
        let top = f64::from(setting.rungs.top());
        Some([-half, 0.0, half].map(|offset| (self.position + offset).clamp(0.0, top)))
    }
}

/// The rung nearest to a position.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the position is clamped to the rungs"
)]
fn nearest_rung(position: f64, top: u32) -> u32 {
    libm::round(position.clamp(0.0, f64::from(top))) as u32
}
