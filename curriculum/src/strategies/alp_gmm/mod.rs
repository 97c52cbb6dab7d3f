//! ALP-GMM: samples params where success has been changing.
//!
//! Teacher algorithms for curriculum learning of deep RL (Portelas et al. 2019). The absolute learning progress of a
//! group is the difference between its reward and that of the nearest earlier group. A Gaussian mixture over (params,
//! progress) is fitted at regular intervals on the latest groups. A proposal samples a component by its mean progress,
//! then params from the component. A share of the proposals stays uniform, so that params that become learnable are
//! found. Rewards are success rates; scenarios need not be contested.
//!
//! A fit takes tens of milliseconds. It starts at one outcome and takes effect at a fixed later one. Until then any
//! thread may compute it ([`fit::MixtureFit`]); otherwise the first proposal from it computes it, with the same result.
//! A replay of events takes the stored proposals of mixtures that are not computed, so that it computes no fit.

mod explain;
mod fit;
mod history;
mod mixture;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use self::fit::{MixtureFit, RngKey};
use self::history::GroupHistory;
use self::mixture::{ComponentRange, Mixture};
use crate::core::evidence::level_move::LevelMove;
use crate::core::explanation::Explanation;
use crate::core::outcome::GroupOutcome;
use crate::core::proposal::{Proposal, ProposalRole};
use crate::core::sampler_state::SamplerOutlook;
use crate::core::scale::LevelScale;
use crate::core::settings::hyperparameters::alp_gmm::{MAX_COMPONENTS, MIN_COMPONENTS, UNIFORM, WINDOW};
use crate::core::settings::{Settings, TaskPlan};
use crate::core::shares;
use crate::core::strategy::{BackgroundJob, Strategy, StrategyContext, StrategyState, drop_stale_tasks};

/// Number of outcomes between the start of a fit and the point where it takes effect.
const FIT_DELAY: u32 = 25;

/// State of ALP-GMM: the learning progress of each task.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct AlpGmm {
    tasks: BTreeMap<String, LearningProgress>,
}

/// Learning progress of a task, and the mixture fitted to it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct LearningProgress {
    /// Latest groups, among which the nearest is searched.
    history: GroupHistory,
    /// Latest groups on which a mixture is fitted: for each, its params as fractions, then its progress.
    window: VecDeque<Vec<f64>>,
    /// Number of outcomes so far.
    seen: u64,
    /// Number of outcomes since the last fit started.
    since: u32,
    /// Fit whose mixture is in force, if any.
    #[serde(with = "fit::shared_fit")]
    in_force: Option<Arc<MixtureFit>>,
    /// Number of fits that took effect.
    fits: u32,
    /// Fit in progress, if any.
    #[serde(with = "fit::shared_fit")]
    fit: Option<Arc<MixtureFit>>,
}

/// Params sampled from a component.
struct SampledParams {
    /// Params as fractions of the level table.
    fractions: Vec<f64>,
    /// Mean progress of the component.
    progress: f64,
}

impl Strategy for AlpGmm {
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal {
        let mut rng = ctx.rng();
        let plan = shares::pick_task(ctx.settings, rng.uniform());
        self.tasks.entry(plan.task.clone()).or_default().propose(ctx.settings, plan, &mut rng)
    }

    fn propose_again(&mut self, ctx: &StrategyContext<'_>) -> Option<Proposal> {
        let plan = shares::pick_task(ctx.settings, ctx.rng().uniform());
        let in_force = self.tasks.entry(plan.task.clone()).or_default().in_force.as_ref();
        if in_force.is_some_and(|fit| !fit.is_computed()) { None } else { Some(self.propose(ctx)) }
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        let plan = ctx.settings.task(&outcome.task);
        if let (Some(plan), Some(reward), true) = (plan, outcome.success_rate(), outcome.usable) {
            let fractions = LevelScale::new(plan).fractions(&outcome.params);
            let progress = self.tasks.entry(outcome.task.clone()).or_default();
            progress.observe(ctx, &fractions, reward);
        }
        Vec::new()
    }

    fn change_settings(&mut self, restarted: &[&str], ctx: &StrategyContext<'_>) {
        drop_stale_tasks(&mut self.tasks, restarted, ctx);
    }

    fn take_background_jobs(&self) -> Vec<Arc<dyn BackgroundJob>> {
        let fits = self.tasks.values().filter_map(|progress| progress.fit.clone());
        fits.filter(|fit| fit.take()).map(|fit| fit as Arc<dyn BackgroundJob>).collect()
    }

    fn sampler(&self, _plan: &TaskPlan, _ctx: &StrategyContext<'_>) -> SamplerOutlook {
        SamplerOutlook::of_params()
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        explain::explain(self, settings)
    }
}

impl StrategyState for AlpGmm {
    const VERSION: u32 = 2;

    fn new(_settings: &Settings) -> Self {
        Self::default()
    }
}

impl LearningProgress {
    fn propose(&self, settings: &Settings, plan: &TaskPlan, rng: &mut KeyedRng) -> Proposal {
        let scale = LevelScale::new(plan);
        let is_uniform = rng.bernoulli(settings.hyperparameters.number(&UNIFORM));
        let mixture = if is_uniform { None } else { self.mixture() };
        let (fractions, why) = match mixture.and_then(|mixture| sample(mixture, scale.len(), rng)) {
            Some(SampledParams { fractions, progress }) => (
                fractions,
                format!("params drawn where success has been changing, by {progress:.2} on the mean"),
            ),
            None => {
                let fractions = (0..scale.len()).map(|_| rng.uniform()).collect();
                (fractions, "params drawn uniformly".to_owned())
            }
        };
        let positions: Vec<f64> = fractions.iter().map(|fraction| fraction * scale.last_position()).collect();
        Proposal {
            why,
            params: scale.params(&positions),
            ..Proposal::fresh(plan, None, ProposalRole::Sample)
        }
    }

    /// Mixture in force, computed now if no thread has done it; `None` before the first fit took effect.
    fn mixture(&self) -> Option<&Mixture> {
        self.in_force.as_deref().and_then(MixtureFit::mixture)
    }

    /// Records the reward of a group, puts a fit in force that is due, and starts the next one.
    fn observe(&mut self, ctx: &StrategyContext<'_>, fractions: &[f64], reward: f64) {
        let hyperparameters = &ctx.settings.hyperparameters;
        let window = hyperparameters.integer(&WINDOW);
        self.record(fractions, reward, window as usize);
        self.seen = self.seen.saturating_add(1);
        self.since = self.since.saturating_add(1);
        if self.fit.is_some() && self.since >= FIT_DELAY {
            // A fit of too few points keeps the mixture before it.
            if let Some(fit) = self.fit.take().filter(|fit| fit.has_enough_points()) {
                self.in_force = Some(fit);
                self.fits = self.fits.saturating_add(1);
            }
        }
        if self.fit.is_none() && self.since >= window {
            self.since = 0;
            let min = hyperparameters.integer(&MIN_COMPONENTS);
            let max = hyperparameters.integer(&MAX_COMPONENTS).max(min);
            let points = self.window.iter().cloned().collect();
            let rng_key = RngKey { run_seed: ctx.run_seed, seq: ctx.seq };
            self.fit = Some(Arc::new(MixtureFit::new(points, ComponentRange { min, max }, rng_key)));
        }
    }

    /// Adds a group to the history, and its learning progress to the window.
    fn record(&mut self, fractions: &[f64], reward: f64, window: usize) {
        if let Some(earlier_reward) = self.history.nearest_reward(fractions) {
            let progress = (reward - earlier_reward).abs();
            while self.window.len() >= window {
                self.window.pop_front();
            }
            self.window.push_back(fractions.iter().copied().chain([progress]).collect());
        }
        self.history.record(self.seen, fractions, reward);
    }
}

/// Samples a component by its mean progress, then params from it; `None` if its covariance is degenerate.
fn sample(mixture: &Mixture, width: usize, rng: &mut KeyedRng) -> Option<SampledParams> {
    let progress: Vec<f64> =
        mixture.components.iter().map(|component| component.mean_progress().max(0.0)).collect();
    let chosen = rng.weighted_index(&progress)?;
    let fractions = mixture.components[chosen].sample(width, rng)?;
    let fractions = fractions.into_iter().map(|fraction| fraction.clamp(0.0, 1.0)).collect();
    Some(SampledParams { fractions, progress: progress[chosen] })
}
