//! Hyperparameters of automatic domain randomisation (adr).

use super::spec::{Hyperparameter, ValueRange};

pub(crate) const BOUNDARY: Hyperparameter = Hyperparameter {
    name: "boundary",
    range: ValueRange::Number { default: 0.5, min: 0.0, max: 1.0 },
    description: "share of proposals with one param at its bound",
    source: "Akkaya et al. 2019, p_r",
};
pub(crate) const BUFFER: Hyperparameter = Hyperparameter {
    name: "buffer",
    range: ValueRange::Whole { default: 32, min: 4, max: 10_000 },
    description: "number of contested scenarios at a bound after which it may move",
    source: "a block of the ladder; Akkaya et al. 2019 use 240 episodes",
};
pub(crate) const WIDEN: Hyperparameter = Hyperparameter {
    name: "widen",
    range: ValueRange::Number { default: 0.7, min: 0.0, max: 1.0 },
    description: "mean success rate from which a bound widens, missing episodes counted as failures",
    source: "the ladder's threshold; Akkaya et al. 2019 use at least 20 successes of 50",
};
pub(crate) const NARROW: Hyperparameter = Hyperparameter {
    name: "narrow",
    range: ValueRange::Number { default: 0.3, min: 0.0, max: 1.0 },
    description: "mean success rate up to which a bound narrows, missing episodes counted as successes",
    source: "the ladder's threshold; Akkaya et al. 2019 use at most 10 successes of 50",
};
pub(crate) const STEP: Hyperparameter = Hyperparameter {
    name: "step",
    range: ValueRange::Number { default: 0.5, min: 0.01, max: 10.0 },
    description: "rows of the level table by which a bound moves",
    source: "own choice; Akkaya et al. 2019 choose a step for each param by hand",
};

pub(crate) const ALL: &[Hyperparameter] = &[BOUNDARY, BUFFER, WIDEN, NARROW, STEP];
