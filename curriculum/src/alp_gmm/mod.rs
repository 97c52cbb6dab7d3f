//! ALP-GMM: params are drawn where success has been changing.
//!
//! Teacher algorithms for curriculum learning of deep RL (Portelas et al. 2019): the absolute learning progress of a draw is how far
//! its reward is from that of the nearest draw before; a Gaussian mixture over (params, progress) is fitted every so many outcomes
//! on the last ones; a component is drawn by its mean progress, and params from it. A share stays uniform, so that what becomes
//! learnable is found. Rewards are success shares; scenarios are as they come.
//!
//! A fit takes tens of milliseconds. It is begun at one outcome and put in force at a fixed later one: whoever has time computes it in
//! between ([`Fit::run`]), and where nobody did it is computed when it is due. The same comes out.

mod mixture;
mod words;

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use env_core::Draws;
use env_core::draws::Purpose;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use self::mixture::Mixture;
use super::event::{GroupOutcome, Move, Proposal, Role};
use super::explain::{Explanation, TaskStatus};
use super::scale::Scale;
use super::settings::{Settings, TaskPlan};
use super::shares;
use super::strategy::{Context, Job, Strategy};
use super::tuning::{Hyper, Range};

const VERSION: u32 = 1;

/// Draws among which the nearest is looked for.
const HISTORY: u64 = 2500;
/// Outcomes between the beginning of a fit and its being in force.
const LATER: u32 = 25;

pub(super) const WINDOW: Hyper = Hyper {
    name: "window",
    range: Range::Whole { default: 250, min: 20, max: 2500 },
    about: "outcomes of a task after which a mixture is fitted, and on which",
    source: "Portelas et al. 2019, section 4",
};
pub(super) const LEAST: Hyper = Hyper {
    name: "least_components",
    range: Range::Whole { default: 2, min: 1, max: 20 },
    about: "components of a mixture, at least",
    source: "Portelas et al. 2019, section 4",
};
pub(super) const MOST: Hyper = Hyper {
    name: "most_components",
    range: Range::Whole { default: 10, min: 1, max: 20 },
    about: "components of a mixture, at most",
    source: "Portelas et al. 2019, section 4",
};
pub(super) const UNIFORM: Hyper = Hyper {
    name: "uniform",
    range: Range::Number { default: 0.2, min: 0.0, max: 1.0 },
    about: "share of draws that no mixture decides",
    source: "Portelas et al. 2019, p_rnd",
};

pub(super) const HYPERS: &[Hyper] = &[WINDOW, LEAST, MOST, UNIFORM];

/// What is known of each task.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct AlpGmm {
    tasks: BTreeMap<String, Task>,
}

/// What is known of a task.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Task {
    /// The last draws, as shares of the way through the table, each followed by its reward: a ring, one after the other.
    history: Vec<f64>,
    /// The last of them with their progress at the end.
    window: VecDeque<Vec<f64>>,
    /// Outcomes so far.
    seen: u64,
    /// Outcomes since the last fit was begun.
    since: u32,
    mixture: Option<Mixture>,
    fits: u32,
    /// Under way.
    #[serde(with = "shared")]
    fit: Option<Arc<Fit>>,
}

/// A fit under way.
#[derive(Debug, Serialize, Deserialize)]
struct Fit {
    points: Vec<Vec<f64>>,
    components: (u32, u32),
    /// What its draws are drawn by: run seed and seq.
    drawn: (u64, u64),
    #[serde(skip)]
    done: OnceLock<Option<Mixture>>,
    /// Whether somebody was told of it.
    #[serde(skip)]
    told: AtomicBool,
}

/// A fit as it is stored: whoever else has it is no part of it.
mod shared {
    use std::sync::Arc;

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::Fit;

    pub(super) fn serialize<S: Serializer>(fit: &Option<Arc<Fit>>, to: S) -> Result<S::Ok, S::Error> {
        fit.as_deref().serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Arc<Fit>>, D::Error> {
        Ok(Option::<Fit>::deserialize(from)?.map(Arc::new))
    }
}

impl Fit {
    fn mixture(&self) -> Option<Mixture> {
        let fit = || {
            let mut draws = Draws::new(Purpose::Course, self.drawn.0, self.drawn.1);
            Mixture::best(&self.points, self.components, &mut draws)
        };
        self.done.get_or_init(fit).clone()
    }
}

impl Job for Fit {
    fn run(&self) {
        let _computed = self.mixture();
    }
}

impl AlpGmm {
    pub(super) fn restore(state: &Value) -> Result<Self, serde_json::Error> {
        Self::deserialize(state)
    }
}

impl Task {
    fn propose(&self, settings: &Settings, plan: &TaskPlan, draws: &mut Draws) -> Proposal {
        let scale = Scale::of(plan);
        let uniform = draws.chance(settings.tuning.number(&UNIFORM));
        let drawn = self
            .mixture
            .as_ref()
            .filter(|_| !uniform)
            .and_then(|mixture| Self::draw(mixture, scale.len(), draws));
        let (shares, why) = match drawn {
            Some((shares, progress)) => (
                shares,
                format!("params drawn where success has been changing, by {progress:.2} on the mean"),
            ),
            None => {
                let shares = (0..scale.len()).map(|_| draws.uniform()).collect();
                (shares, "params drawn uniformly".to_owned())
            }
        };
        let places: Vec<f64> = shares.iter().map(|share| share * scale.top()).collect();
        Proposal { why, params: scale.params(&places), ..Proposal::at(plan, None, Role::Sample) }
    }

    /// Shares from a component drawn by its mean progress, and that.
    fn draw(mixture: &Mixture, width: usize, draws: &mut Draws) -> Option<(Vec<f64>, f64)> {
        let progress: Vec<f64> =
            mixture.components.iter().map(|c| c.mean.last().copied().unwrap_or(0.0).max(0.0)).collect();
        let chosen = draws.weighted(&progress)?;
        let shares = mixture.components[chosen].sample(width, draws)?;
        Some((shares.into_iter().map(|share| share.clamp(0.0, 1.0)).collect(), progress[chosen]))
    }

    fn observe(&mut self, settings: &Settings, (shares, reward): (Vec<f64>, f64), drawn: (u64, u64)) {
        let gap = |other: &[f64]| shares.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        let draws = self.history.chunks_exact(shares.len() + 1);
        let nearest = draws.min_by(|a, b| gap(a).total_cmp(&gap(b)));
        if let Some(before) = nearest.and_then(<[f64]>::last) {
            let progress = (reward - before).abs();
            let window = settings.tuning.whole(&WINDOW) as usize;
            while self.window.len() >= window {
                self.window.pop_front();
            }
            self.window.push_back(shares.iter().copied().chain([progress]).collect());
        }
        let at = (self.seen % HISTORY) as usize * (shares.len() + 1);
        let draw = shares.into_iter().chain([reward]);
        if at == self.history.len() {
            self.history.extend(draw);
        } else {
            self.history.iter_mut().skip(at).zip(draw).for_each(|(old, new)| *old = new);
        }
        self.seen += 1;
        self.since += 1;
        if self.fit.is_some() && self.since >= LATER {
            // One that found nothing leaves what there was.
            if let Some(mixture) = self.fit.take().and_then(|fit| fit.mixture()) {
                self.mixture = Some(mixture);
                self.fits = self.fits.saturating_add(1);
            }
        }
        if self.fit.is_none() && self.since >= settings.tuning.whole(&WINDOW) {
            self.since = 0;
            let (least, most) = (settings.tuning.whole(&LEAST), settings.tuning.whole(&MOST));
            let points = self.window.iter().cloned().collect();
            let (done, told) = (OnceLock::new(), AtomicBool::new(false));
            self.fit =
                Some(Arc::new(Fit { points, components: (least, most.max(least)), drawn, done, told }));
        }
    }
}

impl Strategy for AlpGmm {
    fn propose(&mut self, ctx: &Context<'_>) -> Proposal {
        let mut draws = ctx.draws();
        let plan = shares::pick(ctx.settings, draws.uniform());
        self.tasks.entry(plan.task.clone()).or_default().propose(ctx.settings, plan, &mut draws)
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &Context<'_>) -> Vec<Move> {
        let plan = ctx.settings.task(&outcome.task);
        if let (Some(plan), Some(reward), true) = (plan, outcome.value(), outcome.evidence) {
            let shares = Scale::of(plan).shares(&outcome.params);
            let task = self.tasks.entry(outcome.task.clone()).or_default();
            task.observe(ctx.settings, (shares, reward), (ctx.run_seed, ctx.seq));
        }
        Vec::new()
    }

    fn adopt(&mut self, afresh: &[&str], ctx: &Context<'_>) {
        self.tasks.retain(|task, _| ctx.settings.task(task).is_some() && !afresh.contains(&task.as_str()));
    }

    fn jobs(&self) -> Vec<Arc<dyn Job>> {
        let fits = self.tasks.values().filter_map(|task| task.fit.clone());
        fits.filter(|fit| !fit.told.swap(true, Ordering::Relaxed)).map(|fit| fit as Arc<dyn Job>).collect()
    }

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        settings.tasks.iter().map(|plan| TaskStatus::unmoved(&plan.task, Vec::new())).collect()
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        words::explain(self, settings)
    }

    fn snapshot(&self) -> Value {
        serde_json::to_value(self).expect("a state of finite numbers and string keys has a JSON form")
    }

    fn version(&self) -> u32 {
        VERSION
    }

    fn boxed_clone(&self) -> Box<dyn Strategy> {
        Box::new(self.clone())
    }
}
