//! Hyperparameters of the staircase (staircase).

use super::spec::{Hyperparameter, ValueRange};

pub(crate) const CHAINS: Hyperparameter = Hyperparameter {
    name: "chains",
    range: ValueRange::Whole { default: 32, min: 1, max: 1024 },
    description: "number of chains that climb the rungs of a task",
    source: "own choice: about one chain for four environments",
};
pub(crate) const STEP: Hyperparameter = Hyperparameter {
    name: "step",
    range: ValueRange::Number { default: 0.25, min: 0.01, max: 2.0 },
    description: "rungs by which a success moves a chain up and a failure moves it down",
    source: "Levitt 1971; a quarter, because the rungs are near each other",
};
pub(crate) const COVERAGE: Hyperparameter = Hyperparameter {
    name: "coverage",
    range: ValueRange::Number { default: 0.03, min: 0.0, max: 1.0 },
    description: "share of the steps, not of the episodes, that is drawn uniformly from all rungs",
    source: "own choice, against forgetting",
};

pub(crate) const ALL: &[Hyperparameter] = &[CHAINS, STEP, COVERAGE];
