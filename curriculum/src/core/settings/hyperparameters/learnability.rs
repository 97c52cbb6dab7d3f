//! Hyperparameters of sampling for learnability (learnability).

use super::spec::{Hyperparameter, ValueRange};

pub(crate) const RANK: Hyperparameter = Hyperparameter {
    name: "rank",
    range: ValueRange::Choice(&["model", "rollouts"]),
    description: "ranking of scenarios: by a logistic model over params and the blind panel's success, or by \
                  rollouts of each",
    source: "Rutherford et al. 2024 roll out; the model is our own, because rollouts are steps without training",
};
pub(crate) const CANDIDATES: Hyperparameter = Hyperparameter {
    name: "candidates",
    range: ValueRange::Whole { default: 32, min: 2, max: 100_000 },
    description: "number of fresh scenarios of a task, N, after which the kept ones are replaced",
    source: "Rutherford et al. 2024 use 5 000; with so few the kept ones are renewed while the agent learns",
};
pub(crate) const ROLLOUTS: Hyperparameter = Hyperparameter {
    name: "rollouts",
    range: ValueRange::Whole { default: 8, min: 2, max: 1024 },
    description: "number of episodes of each candidate, L; smaller groups are repeated until they add up to it",
    source: "Rutherford et al. 2024 use some tens; a GRPO group has 8",
};
pub(crate) const KEPT: Hyperparameter = Hyperparameter {
    name: "kept",
    range: ValueRange::Whole { default: 8, min: 1, max: 10_000 },
    description: "number of candidates of a task that are kept",
    source: "Rutherford et al. 2024 keep one in five; here one in four",
};
pub(crate) const SHARE: Hyperparameter = Hyperparameter {
    name: "share",
    range: ValueRange::Number { default: 0.5, min: 0.0, max: 1.0 },
    description: "share of proposals that repeat a kept scenario, or that the model chooses",
    source: "Rutherford et al. 2024, ρ",
};
pub(crate) const AMONG: Hyperparameter = Hyperparameter {
    name: "among",
    range: ValueRange::Whole { default: 8, min: 1, max: 64 },
    description: "number of fresh scenarios from which the model chooses one",
    source: "own choice; each takes a bracket, 0.5 to 5 ms",
};

pub(crate) const ALL: &[Hyperparameter] = &[RANK, CANDIDATES, ROLLOUTS, KEPT, SHARE, AMONG];

/// Method that ranks scenarios: the choices of [`RANK`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RankingMethod {
    /// Several episodes of each candidate.
    Rollouts,
    /// Logistic model over params and the share of blind plans that succeed.
    Model,
}

impl RankingMethod {
    /// Method with this name; the model, the default, for any other name.
    pub(crate) fn from_name(name: &str) -> Self {
        match name {
            "rollouts" => Self::Rollouts,
            _ => Self::Model,
        }
    }
}
