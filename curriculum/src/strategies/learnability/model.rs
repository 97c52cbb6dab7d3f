//! Logistic model of success, from a scenario's params and the share of blind plans that succeed on it.

use std::collections::VecDeque;

use env_core::KeyedRng;
use nalgebra::{DMatrix, DVector, DVectorView};
use serde::{Deserialize, Serialize};

use crate::core::outcome::GroupOutcome;
use crate::core::proposal::{Proposal, ProposalRole, ScenarioSource};
use crate::core::scale::LevelScale;
use crate::core::settings::TaskPlan;

/// Factor by which each outcome discounts the weights of those before it: the agent changes while it trains.
const DISCOUNT: f64 = 0.99;
/// Number of outcomes that the model is fitted on. The weight of an older one would be below a twelfth.
const WINDOW: usize = 256;
/// Number of outcomes between two fits.
const FIT_INTERVAL: u32 = 8;
/// Largest number of Newton steps of a fit; from zero it takes five or six.
const MAX_NEWTON_STEPS: usize = 20;
/// Weight of the penalty on coefficients: a prior of standard deviation 1 on features within 0 to 1. It keeps the
/// coefficients finite if success is always or never seen.
const RIDGE: f64 = 1.0;

/// Logistic model of success. Its features are 1, each param as a fraction of the level table, and the share of blind
/// plans that succeed.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct SuccessModel {
    /// Features and success rate of the latest outcomes.
    seen: VecDeque<(Vec<f64>, f64)>,
    /// Number of outcomes since the last fit.
    since: u32,
    /// Coefficients; `None` before the first fit, when all are zero.
    pub(super) fitted: Option<Vec<f64>>,
}

impl SuccessModel {
    /// Records the outcome of a scenario, and fits the model if it is due.
    pub(super) fn observe(&mut self, plan: &TaskPlan, outcome: &GroupOutcome) {
        let Some(success_rate) = outcome.success_rate() else { return };
        let features = features(plan, outcome.level, outcome.signals.panel.unwrap_or(0.0));
        if self.seen.len() == WINDOW {
            self.seen.pop_front();
        }
        self.seen.push_back((features, success_rate));
        self.since = self.since.saturating_add(1);
        if self.since >= FIT_INTERVAL {
            self.since = 0;
            self.fitted = fit(&self.seen);
        }
    }

    /// Proposes the scenario nearest one half among `among` fresh ones of a level. The level is drawn by its predicted p(1 − p)
    /// where half of the blind plans succeed; before the first fit all levels are equally likely.
    pub(super) fn choose(&self, plan: &TaskPlan, among: u32, rng: &mut KeyedRng) -> Option<Proposal> {
        let level = u32::try_from(rng.weighted_index(&self.level_weights(plan))?).ok()?;
        let base = self.logit(plan, level, 0.0);
        let source = ScenarioSource::Chosen { among, base, panel: self.logit(plan, level, 1.0) - base };
        let why = format!(
            "level {level}, where {:.2} is predicted to succeed; of {among} scenarios the one nearest one half",
            logistic(self.logit(plan, level, 0.5))
        );
        Some(Proposal { source, why, ..Proposal::fresh(plan, Some(level), ProposalRole::Replay) })
    }

    /// Weight of each level: its predicted p(1 − p) where half of the blind plans succeed.
    pub(super) fn level_weights(&self, plan: &TaskPlan) -> Vec<f64> {
        let learnability = |level: u32| {
            let p = logistic(self.logit(plan, level, 0.5));
            p * (1.0 - p)
        };
        (0..=plan.hardest_level()).map(learnability).collect()
    }

    /// Predicted logit of success at a level, where a share of the blind plans succeeds.
    fn logit(&self, plan: &TaskPlan, level: u32, panel: f64) -> f64 {
        let fitted = self.fitted.as_deref().unwrap_or_default();
        dot(fitted, &features(plan, Some(level), panel))
    }
}

fn features(plan: &TaskPlan, level: Option<u32>, panel: f64) -> Vec<f64> {
    let fractions = LevelScale::new(plan).fractions(&plan.params(level));
    std::iter::once(1.0).chain(fractions).chain([panel]).collect()
}

/// Fits the coefficients by penalised maximum likelihood of the discounted outcomes with Newton's method (iteratively reweighted least squares:
/// Nelder and Wedderburn 1972).
fn fit(seen: &VecDeque<(Vec<f64>, f64)>) -> Option<Vec<f64>> {
    let width = seen.front()?.0.len();
    let ages = (0..seen.len()).rev().map(|age| libm::pow(DISCOUNT, age as f64));
    let rows: Vec<(DVectorView<'_, f64>, f64, f64)> = seen
        .iter()
        .zip(ages)
        .filter(|((features, _), _)| features.len() == width)
        .map(|((features, success_rate), weight)| {
            (DVectorView::from_slice(features, width), *success_rate, weight)
        })
        .collect();
    let mut beta = DVector::<f64>::zeros(width);
    for _ in 0..MAX_NEWTON_STEPS {
        let mut gradient = &beta * -RIDGE;
        let mut hessian = DMatrix::<f64>::identity(width, width) * RIDGE;
        for (x, success_rate, weight) in &rows {
            let p = logistic(beta.dot(x));
            gradient.iter_mut().zip(x).for_each(|(sum, x)| *sum += x * (success_rate - p) * *weight);
            add_outer_product(&mut hessian, x.as_slice(), weight * p * (1.0 - p));
        }
        let step = hessian.cholesky()?.solve(&gradient);
        beta += &step;
        if step.amax() < 1e-9 {
            break;
        }
    }
    beta.iter().all(|value| value.is_finite()).then(|| beta.iter().copied().collect())
}

/// Adds `weight` · x xᵀ to the lower triangle of a matrix, the part that a Cholesky decomposition reads. A matrix for each product would
/// take most of the time of a fit.
fn add_outer_product(matrix: &mut DMatrix<f64>, x: &[f64], weight: f64) {
    for (column, sums) in matrix.as_mut_slice().chunks_exact_mut(x.len()).enumerate() {
        for (sum, value) in sums[column..].iter_mut().zip(&x[column..]) {
            *sum += value * x[column] * weight;
        }
    }
}

/// Logistic function, 1/(1 + e^−x).
fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-x))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use env_core::keyed_rng::RngPurpose;

    use super::*;
    use crate::tests::outcome;

    /// At the fit, the gradient of the unpenalised likelihood equals the penalty's: with a weight of 1, the
    /// coefficients. Without a penalty, two features (a constant, and one that is 0 or 1) have the logits of the
    /// success rates as a closed form.
    #[test]
    fn fit_balances_likelihood_and_penalty() {
        let mut seen = VecDeque::new();
        for n in 0..200u32 {
            let side = f64::from(n % 2);
            let success_rate = if n % 2 == 0 { 0.8 } else { 0.25 };
            seen.push_back((vec![1.0, side], success_rate));
        }
        let fitted = fit(&seen).unwrap();
        for at in 0..2 {
            let terms = seen.iter().rev().enumerate().map(|(age, (x, v))| {
                libm::pow(DISCOUNT, age as f64) * (v - logistic(dot(&fitted, x))) * x[at]
            });
            let gradient: f64 = terms.sum();
            assert!((gradient - fitted[at]).abs() < 1e-6, "{gradient} {fitted:?}");
        }
        let logit = |p: f64| libm::log(p / (1.0 - p));
        // The weights of each add up to 43, against a prior of one.
        assert!((fitted[0] - logit(0.8)).abs() < 0.5 && (fitted[0] + fitted[1] - logit(0.25)).abs() < 0.5);
    }

    #[test]
    fn certain_success_gives_finite_coefficients() {
        let seen: VecDeque<_> = (0..64).map(|_| (vec![1.0, 0.5, 0.0], 1.0)).collect();
        assert!(fit(&seen).unwrap().iter().all(|value| value.is_finite()));
    }

    #[test]
    fn levels_near_one_half_are_chosen_most() {
        let plan = TaskPlan::standard("kessler/survival").unwrap();
        let mut model = SuccessModel::default();
        let mut rng = KeyedRng::new(RngPurpose::Curriculum, 3, 3);
        assert!(model.choose(&plan, 4, &mut rng).unwrap().why.contains("0.50 is predicted"));
        for n in 0..256u32 {
            let level = n % 10;
            let outcome = GroupOutcome {
                successes: u32::from(rng.bernoulli(if level < 5 { 0.95 } else { 0.05 })),
                ..outcome("kessler/survival", Some(level), 1, 0)
            };
            model.observe(&plan, &outcome);
        }
        let mut counts = [0u32; 10];
        for _ in 0..1000 {
            let proposal = model.choose(&plan, 4, &mut rng).unwrap();
            counts[proposal.level.unwrap() as usize] += 1;
            assert!(matches!(proposal.source, ScenarioSource::Chosen { among: 4, .. }));
        }
        let middle: u32 = counts[3..7].iter().sum();
        assert!(middle > 500, "{counts:?}");
    }
}
