//! Hyperparameters of ALP-GMM (alp_gmm).

use super::spec::{Hyperparameter, ValueRange};

pub(crate) const WINDOW: Hyperparameter = Hyperparameter {
    name: "window",
    range: ValueRange::Whole { default: 250, min: 20, max: 2500 },
    description: "number of outcomes between two fits of a task, and in each fit",
    source: "Portelas et al. 2019, section 4",
};
pub(crate) const MIN_COMPONENTS: Hyperparameter = Hyperparameter {
    name: "least_components",
    range: ValueRange::Whole { default: 2, min: 1, max: 20 },
    description: "smallest number of components of a mixture",
    source: "Portelas et al. 2019, section 4",
};
pub(crate) const MAX_COMPONENTS: Hyperparameter = Hyperparameter {
    name: "most_components",
    range: ValueRange::Whole { default: 10, min: 1, max: 20 },
    description: "largest number of components of a mixture",
    source: "Portelas et al. 2019, section 4",
};
pub(crate) const UNIFORM: Hyperparameter = Hyperparameter {
    name: "uniform",
    range: ValueRange::Number { default: 0.2, min: 0.0, max: 1.0 },
    description: "share of proposals whose params are uniform",
    source: "Portelas et al. 2019, p_rnd",
};

pub(crate) const ALL: &[Hyperparameter] = &[WINDOW, MIN_COMPONENTS, MAX_COMPONENTS, UNIFORM];
