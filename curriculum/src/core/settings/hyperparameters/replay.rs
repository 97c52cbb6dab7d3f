//! Hyperparameters of prioritized level replay (plr, plr_robust, accel).

use super::spec::{Hyperparameter, ValueRange};

pub(crate) const REPLAY: Hyperparameter = Hyperparameter {
    name: "replay",
    range: ValueRange::Number { default: 0.5, min: 0.0, max: 1.0 },
    description: "probability that a proposal repeats a kept scenario, once there are enough",
    source: "Jiang et al. 2021b, table 3; Parker-Holder et al. 2022 repeat 0.8",
};
pub(crate) const SCORE: Hyperparameter = Hyperparameter {
    name: "score",
    range: ValueRange::Choice(&["learnability", "regret", "positive_value_loss", "max_mc"]),
    description: "teaching value of a scenario: k(L − k)/(L(L − 1)) for k successes in L episodes, in groups of \
                  one their regret; max(0, reference − score)/(reference − floor); or what the trainer \
                  reports with its results",
    source: "Rutherford et al. 2024; the planner's reference is a lower bound on the best; Jiang et al. \
             2021 and 2021b",
};
pub(crate) const BETA: Hyperparameter = Hyperparameter {
    name: "beta",
    range: ValueRange::Number { default: 0.3, min: 0.01, max: 10.0 },
    description: "temperature of sampling by rank; smaller values favour the first ranks",
    source: "Jiang et al. 2021b, table 3",
};
pub(crate) const STALENESS: Hyperparameter = Hyperparameter {
    name: "staleness",
    range: ValueRange::Number { default: 0.3, min: 0.0, max: 1.0 },
    description: "share of repeats sampled by how long ago the scenario was proposed, so that scores stay \
                  current",
    source: "Jiang et al. 2021b, table 3",
};
pub(crate) const CAPACITY: Hyperparameter = Hyperparameter {
    name: "capacity",
    range: ValueRange::Whole { default: 4000, min: 1, max: 100_000 },
    description: "number of scenarios to keep, of all tasks together",
    source: "Jiang et al. 2021b, table 3",
};
pub(crate) const FILLED: Hyperparameter = Hyperparameter {
    name: "filled",
    range: ValueRange::Whole { default: 64, min: 1, max: 100_000 },
    description: "number of kept scenarios of a task from which it repeats them",
    source: "own choice; the usual half of the capacity would take days of a language model's episodes",
};
pub(crate) const EDITED: Hyperparameter = Hyperparameter {
    name: "edited",
    range: ValueRange::Number { default: 1.0, min: 0.0, max: 1.0 },
    description: "probability that a repeated scenario is edited",
    source: "Parker-Holder et al. 2022, algorithm 1",
};

pub(crate) const PLR: &[Hyperparameter] = &[REPLAY, SCORE, BETA, STALENESS, CAPACITY, FILLED];
pub(crate) const ACCEL: &[Hyperparameter] = &[REPLAY, SCORE, BETA, STALENESS, CAPACITY, FILLED, EDITED];

/// Measure of how much a scenario can teach: the choices of [`SCORE`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ScenarioScore {
    /// Shortfall from the planner's reference.
    Regret,
    /// Estimate of p(1 − p) from the group's own episodes.
    Learnability,
    /// Positive value loss, as the trainer reports it.
    PositiveValueLoss,
    /// MaxMC regret, as the trainer reports it.
    MaxMc,
}

impl ScenarioScore {
    /// Measure with this name; learnability, the default, for any other name.
    pub(crate) fn from_name(name: &str) -> Self {
        match name {
            "regret" => Self::Regret,
            "positive_value_loss" => Self::PositiveValueLoss,
            "max_mc" => Self::MaxMc,
            _ => Self::Learnability,
        }
    }
}
