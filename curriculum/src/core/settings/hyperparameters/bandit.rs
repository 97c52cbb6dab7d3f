//! Hyperparameters of the level bandit (bandit).

use super::spec::{Hyperparameter, ValueRange};

pub(crate) const UNIFORM: Hyperparameter = Hyperparameter {
    name: "uniform",
    range: ValueRange::Number { default: 0.2, min: 0.0, max: 1.0 },
    description: "share of the proposals whose rung is drawn uniformly",
    source: "Portelas et al. 2019, p_rnd",
};
pub(crate) const FORGET: Hyperparameter = Hyperparameter {
    name: "forget",
    range: ValueRange::Number { default: 0.02, min: 0.0, max: 0.5 },
    description: "share of the earlier results of a rung that each episode of it replaces",
    source: "own choice: about fifty episodes count",
};

pub(crate) const ALL: &[Hyperparameter] = &[UNIFORM, FORGET];
