//! How likely a scenario succeeds, from its params and the share of blind plans that succeed on it.

use std::collections::VecDeque;

use env_core::Draws;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::super::event::{GroupOutcome, Proposal, Role, Source};
use super::super::scale::Scale;
use super::super::settings::TaskPlan;

/// Outcomes it rests on: an agent that trains is not the agent it was.
const MEMORY: usize = 256;
/// Outcomes from which it says anything, and after which it is fitted anew.
const EVERY: u32 = 32;
/// Steps of Newton's method at most; from zero it takes five or six.
const STEPS: usize = 20;
/// Weight of the penalty on coefficients: a prior of standard deviation 1 on features within 0 to 1, which keeps them finite where
/// success is always or never.
const RIDGE: f64 = 1.0;

/// A logistic model: features are 1, each param of the table scaled to 0 to 1, and the panel's share of successes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Model {
    /// Features, and the share of successes.
    seen: VecDeque<(Vec<f64>, f64)>,
    /// Outcomes since the last fit.
    since: u32,
    /// Coefficients; none until there are enough outcomes.
    pub(super) fitted: Option<Vec<f64>>,
}

/// 1/(1 + e^−x).
fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-x))
}

impl Model {
    /// Takes the outcome of a scenario as it was drawn.
    pub(super) fn observe(&mut self, plan: &TaskPlan, outcome: &GroupOutcome) {
        let Some(value) = outcome.value() else { return };
        let features = features(plan, outcome.level, outcome.signals.panel.unwrap_or(0.0));
        if self.seen.len() == MEMORY {
            self.seen.pop_front();
        }
        self.seen.push_back((features, value));
        self.since += 1;
        if self.since >= EVERY {
            self.since = 0;
            self.fitted = fit(&self.seen);
        }
    }

    /// A level and how to choose among its scenarios: levels by p(1 − p) as predicted of the middle of the panel.
    pub(super) fn choose(&self, plan: &TaskPlan, among: u32, draws: &mut Draws) -> Option<Proposal> {
        let fitted = self.fitted.as_ref()?;
        let logit = |level: u32, panel: f64| dot(fitted, &features(plan, Some(level), panel));
        let worth = |level: u32| {
            let p = logistic(logit(level, 0.5));
            p * (1.0 - p)
        };
        let worths: Vec<f64> = (0..=plan.top()).map(worth).collect();
        let level = u32::try_from(draws.weighted(&worths)?).ok()?;
        let base = logit(level, 0.0);
        let source = Source::Chosen { among, base, panel: logit(level, 1.0) - base };
        let why = format!(
            "level {level}, where {:.2} is predicted to succeed; of {among} scenarios the one nearest one half",
            logistic(logit(level, 0.5))
        );
        Some(Proposal { source, why, ..Proposal::at(plan, Some(level), Role::Replay) })
    }
}

fn features(plan: &TaskPlan, level: Option<u32>, panel: f64) -> Vec<f64> {
    let scale = Scale::of(plan);
    std::iter::once(1.0).chain(scale.shares(&plan.params(level))).chain([panel]).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Penalised maximum likelihood by Newton's method (iteratively reweighted least squares: Nelder and Wedderburn 1972).
fn fit(seen: &VecDeque<(Vec<f64>, f64)>) -> Option<Vec<f64>> {
    let width = seen.front()?.0.len();
    let rows: Vec<(DVector<f64>, f64)> = seen
        .iter()
        .filter(|(features, _)| features.len() == width)
        .map(|(features, value)| (DVector::from_column_slice(features), *value))
        .collect();
    let mut beta = DVector::<f64>::zeros(width);
    for _ in 0..STEPS {
        let mut gradient = &beta * -RIDGE;
        let mut hessian = DMatrix::<f64>::identity(width, width) * RIDGE;
        for (x, value) in &rows {
            let p = logistic(beta.dot(x));
            gradient += x * (value - p);
            hessian += x * x.transpose() * (p * (1.0 - p));
        }
        let step = hessian.cholesky()?.solve(&gradient);
        beta += &step;
        if step.amax() < 1e-9 {
            break;
        }
    }
    beta.iter().all(|value| value.is_finite()).then(|| beta.iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use env_core::draws::Purpose;

    use super::*;

    /// Two features (a constant and one that is 0 or 1) without a penalty have a closed form: the logits of the shares. With one of
    /// 1 the gradient at the fit is the coefficients: that is what is asked for.
    #[test]
    fn validate_the_fit_is_where_the_gradient_of_the_likelihood_is_the_penalty() {
        let mut seen = VecDeque::new();
        for n in 0..200u32 {
            let side = f64::from(n % 2);
            let rate = if n % 2 == 0 { 0.8 } else { 0.25 };
            seen.push_back((vec![1.0, side], rate));
        }
        let fitted = fit(&seen).unwrap();
        for at in 0..2 {
            let gradient: f64 = seen.iter().map(|(x, v)| (v - logistic(dot(&fitted, x))) * x[at]).sum();
            assert!((gradient - fitted[at]).abs() < 1e-6, "{gradient} {fitted:?}");
        }
        let logit = |p: f64| libm::log(p / (1.0 - p));
        // A hundred outcomes of each against a prior of one: drawn in by about a fifth.
        assert!((fitted[0] - logit(0.8)).abs() < 0.25 && (fitted[0] + fitted[1] - logit(0.25)).abs() < 0.25);
    }

    #[test]
    fn certain_success_stays_finite() {
        let seen: VecDeque<_> = (0..64).map(|_| (vec![1.0, 0.5, 0.0], 1.0)).collect();
        assert!(fit(&seen).unwrap().iter().all(|value| value.is_finite()));
    }

    #[test]
    fn levels_near_one_half_are_chosen_most() {
        let plan = TaskPlan::standard("kessler/survival").unwrap();
        let mut model = Model::default();
        let mut draws = Draws::new(Purpose::Course, 3, 3);
        assert!(model.choose(&plan, 4, &mut draws).is_none());
        for n in 0..256u32 {
            let level = n % 10;
            let outcome = GroupOutcome {
                successes: u32::from(draws.chance(if level < 5 { 0.95 } else { 0.05 })),
                ..super::super::super::tests::outcome("kessler/survival", Some(level), 1, 0)
            };
            model.observe(&plan, &outcome);
        }
        let mut counts = [0u32; 10];
        for _ in 0..1000 {
            let proposal = model.choose(&plan, 4, &mut draws).unwrap();
            counts[proposal.level.unwrap() as usize] += 1;
            assert!(matches!(proposal.source, Source::Chosen { among: 4, .. }));
        }
        let middle: u32 = counts[3..7].iter().sum();
        assert!(middle > 500, "{counts:?}");
    }
}
