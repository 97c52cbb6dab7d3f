//! Probabilities of rungs: equal ones, weights that become shares, and mixtures.

/// Equal probabilities of `count` rungs.
pub(crate) fn uniform_probabilities(count: u32) -> Vec<f64> {
    vec![1.0 / f64::from(count.max(1)); count as usize]
}

/// Weights divided by their sum; equal probabilities if the sum is 0.
pub(crate) fn normalize(weights: &[f64]) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    if sum > 0.0 {
        weights.iter().map(|weight| weight / sum).collect()
    } else {
        uniform_probabilities(u32::try_from(weights.len()).unwrap_or(u32::MAX))
    }
}

/// Mixture: a share of the draws from `first`, 0 to 1, and the others from `rest`.
pub(crate) fn mix(share: f64, first: &[f64], rest: &[f64]) -> Vec<f64> {
    first.iter().zip(rest).map(|(first, rest)| share * first + (1.0 - share) * rest).collect()
}

/// Level of a scenario, and the weight with which the scenario is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LevelWeight {
    pub(crate) level: u32,
    pub(crate) weight: f64,
}

/// Share of each of `count` levels in the weights of scenarios at these levels. If all weights are 0, the first scenario is drawn.
pub(crate) fn level_shares(count: u32, scenarios: impl IntoIterator<Item = LevelWeight>) -> Vec<f64> {
    let mut weights = vec![0.0; count as usize];
    let mut first = None;
    for LevelWeight { level, weight } in scenarios {
        first.get_or_insert(level);
        if let Some(sum) = weights.get_mut(level as usize) {
            *sum += weight;
        }
    }
    if weights.iter().all(|weight| *weight == 0.0)
        && let Some(only) = first.and_then(|level| weights.get_mut(level as usize))
    {
        *only = 1.0;
    }
    normalize(&weights)
}
