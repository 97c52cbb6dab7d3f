//! Hyperparameters of the controller (controller).

use super::spec::{Hyperparameter, ValueRange};
pub(crate) use super::staircase::COVERAGE;

pub(crate) const RATE: Hyperparameter = Hyperparameter {
    name: "rate",
    range: ValueRange::Number { default: 0.03, min: 0.001, max: 1.0 },
    description: "rungs by which an episode moves the position, times tanh(2(s − ½)) for the success rate s of its group",
    source: "Shi et al. 2025, η; one rung after 44 successes",
};
pub(crate) const WIDTH: Hyperparameter = Hyperparameter {
    name: "width",
    range: ValueRange::Number { default: 1.5, min: 0.0, max: 100.0 },
    description: "rungs around the position from which proposals are drawn",
    source: "own choice",
};

pub(crate) const ALL: &[Hyperparameter] = &[RATE, WIDTH, COVERAGE];
