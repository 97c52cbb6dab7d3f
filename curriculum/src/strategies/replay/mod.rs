//! PLR, robust PLR and ACCEL: repeats scenarios on which the agent falls short, and edits them.
//!
//! Prioritized level replay (Jiang, Grefenstette, Rocktäschel 2021): fresh scenarios are scored and the best are kept.
//! Most proposals repeat one of them, drawn by the rank of its score or by how long ago it was proposed. Robust PLR
//! (Jiang et al. 2021b) trains only on repeated scenarios, so that regret selects all that the agent learns from. ACCEL
//! (Parker-Holder et al. 2022) also edits what it repeats: small changes of scenarios at the frontier are at the
//! frontier, too.
//!
//! A *level* of this literature is a scenario here. Each task has a [`level_buffer`] of its own, so that no task
//! starves.

mod explain;
mod level_buffer;
mod outlook;

use std::collections::{BTreeMap, VecDeque};

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use self::level_buffer::{BufferedLevel, LevelBuffer, RankWeights, Visit};
use crate::core::evidence::level_move::LevelMove;
use crate::core::explanation::Explanation;
use crate::core::outcome::GroupOutcome;
use crate::core::proposal::{Proposal, ProposalRole, ScenarioSource};
use crate::core::sampler_state::SamplerOutlook;
use crate::core::settings::hyperparameters::replay::{
    BETA, CAPACITY, EDITED, FILLED, REPLAY, SCORE, STALENESS, ScenarioScore,
};
use crate::core::settings::{Settings, StrategyKind, TaskPlan};
use crate::core::shares;
use crate::core::strategy::{Strategy, StrategyContext, StrategyState, drop_stale_tasks};

/// Largest number of edits that wait for their turn, per task.
const MAX_QUEUED_EDITS: usize = 64;

/// State of PLR, robust PLR or ACCEL: one level buffer for each task. Stored as the map of buffers alone.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Replay {
    tasks: BTreeMap<String, TaskBuffer>,
    /// Derived from the settings.
    #[serde(skip)]
    rank_weights: RankWeights,
}

/// Level buffer of a task, its queue of edits, and counts of what it received.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct TaskBuffer {
    buffer: LevelBuffer,
    /// Seqs of the scenarios to edit, first in first out.
    edits: VecDeque<u64>,
    scored: ScoredOutcomes,
    /// Number of outcomes that lack the score.
    unscored: u64,
}

/// Numbers of scored outcomes by the source of their scenario. Stored as `[fresh, replayed, edited]`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "[u64; 3]", into = "[u64; 3]")]
struct ScoredOutcomes {
    fresh: u64,
    replayed: u64,
    edited: u64,
}

impl Strategy for Replay {
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal {
        let mut rng = ctx.rng();
        let plan = shares::pick_task(ctx.settings, rng.uniform());
        let task = self.tasks.entry(plan.task.clone()).or_default();
        task.propose_edit(plan)
            .or_else(|| task.propose_replay(ctx, plan, &mut rng, &mut self.rank_weights))
            .unwrap_or_else(|| explore(ctx.settings, plan, &mut rng))
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        if outcome.usable && outcome.finished > 0 {
            let task = self.tasks.entry(outcome.task.clone()).or_default();
            task.observe(ctx.settings, outcome, &mut ctx.rng());
        }
        Vec::new()
    }

    fn change_settings(&mut self, restarted: &[&str], ctx: &StrategyContext<'_>) {
        self.rank_weights = RankWeights::new(ctx.settings.hyperparameters.number(&BETA));
        drop_stale_tasks(&mut self.tasks, restarted, ctx);
        for task in self.tasks.values_mut() {
            task.buffer.shrink(capacity(ctx.settings));
        }
    }

    fn retained_proposals(&self) -> Vec<u64> {
        self.tasks.values().flat_map(|task| task.buffer.iter().map(|(seq, _)| seq)).collect()
    }

    fn warnings(&self, task: &str, settings: &Settings) -> Vec<String> {
        self.tasks.get(task).and_then(|buffer| explain::warning(buffer, settings)).into_iter().collect()
    }

    fn sampler(&self, plan: &TaskPlan, ctx: &StrategyContext<'_>) -> SamplerOutlook {
        let empty = TaskBuffer::default();
        let task = self.tasks.get(&plan.task).unwrap_or(&empty);
        let probabilities = outlook::level_probabilities(task, plan, ctx, &self.rank_weights);
        SamplerOutlook::with_level_probabilities(probabilities)
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        explain::explain(self, settings)
    }
}

impl StrategyState for Replay {
    const VERSION: u32 = 1;

    fn new(settings: &Settings) -> Self {
        let rank_weights = RankWeights::new(settings.hyperparameters.number(&BETA));
        Self { tasks: BTreeMap::new(), rank_weights }
    }

    fn resume(self, settings: &Settings) -> Result<Self, String> {
        Ok(Self { tasks: self.tasks, ..Self::new(settings) })
    }
}

/// Largest number of scenarios to keep for a task.
fn capacity(settings: &Settings) -> usize {
    (settings.hyperparameters.integer(&CAPACITY) as usize / settings.tasks.len().max(1)).max(1)
}

/// Number of kept scenarios from which a task repeats them.
fn replay_threshold(settings: &Settings) -> usize {
    (settings.hyperparameters.integer(&FILLED) as usize).min(capacity(settings))
}

/// Score that an outcome gives its scenario; `None` if the outcome lacks it.
fn score(settings: &Settings, outcome: &GroupOutcome) -> Option<f64> {
    let score = match ScenarioScore::from_name(settings.hyperparameters.choice(&SCORE)) {
        ScenarioScore::Regret => outcome.signals.regret,
        // One episode does not show how often the agent succeeds.
        ScenarioScore::Learnability => outcome.learnability().or(outcome.signals.regret),
        ScenarioScore::PositiveValueLoss => outcome.signals.positive_value_loss,
        ScenarioScore::MaxMc => outcome.signals.max_mc,
    };
    score.filter(|score| score.is_finite())
}

/// Proposes a fresh scenario, to be scored.
fn explore(settings: &Settings, plan: &TaskPlan, rng: &mut KeyedRng) -> Proposal {
    let level = rng.below(plan.hardest_level() + 1);
    let contested = rng.bernoulli(settings.contested_share);
    let train = !settings.strategy.trains_on_replays_only();
    let why = match train {
        true => format!("level {level}, drawn uniformly, to score it"),
        false => {
            format!("level {level}, drawn uniformly, to score it; not for training")
        }
    };
    Proposal { contested, train, why, ..Proposal::fresh(plan, Some(level), ProposalRole::Explore) }
}

impl TaskBuffer {
    /// Proposes the next edit whose parent is still in the buffer.
    fn propose_edit(&mut self, plan: &TaskPlan) -> Option<Proposal> {
        while let Some(of) = self.edits.pop_front() {
            let Some(parent) = self.buffer.get(of) else { continue };
            let why = format!(
                "an edit of the scenario of proposal {of}, whose worth is {:.2} over {} visits",
                parent.score, parent.visits
            );
            let source = ScenarioSource::Edited { of };
            return Some(Proposal {
                source,
                train: false,
                why,
                ..Proposal::fresh(plan, parent.level, ProposalRole::Edit)
            });
        }
        None
    }

    /// Proposes a kept scenario again; `None` if there are too few, or by the chance that the settings give to fresh
    /// ones.
    fn propose_replay(
        &mut self,
        ctx: &StrategyContext<'_>,
        plan: &TaskPlan,
        rng: &mut KeyedRng,
        rank_weights: &mut RankWeights,
    ) -> Option<Proposal> {
        let hyperparameters = &ctx.settings.hyperparameters;
        let is_filled = self.buffer.len() >= replay_threshold(ctx.settings);
        if !(is_filled && rng.bernoulli(hyperparameters.number(&REPLAY))) {
            return None;
        }
        let of = if rng.bernoulli(hyperparameters.number(&STALENESS)) {
            self.buffer.sample_by_staleness(rng, ctx.seq)
        } else {
            self.buffer.sample_by_rank(rng, rank_weights)
        }?;
        let level = *self.buffer.get(of)?;
        self.buffer.set_last_proposed(of, ctx.seq);
        let why = format!(
            "the scenario of proposal {of} again: its worth is {:.2} over {} visits{}",
            level.score,
            level.visits,
            if level.generation > 0 {
                format!(", an edit of generation {}", level.generation)
            } else {
                String::new()
            }
        );
        let source = ScenarioSource::Replay { of };
        Some(Proposal { source, why, ..Proposal::fresh(plan, level.level, ProposalRole::Replay) })
    }

    /// Scores the scenario of an outcome and keeps it if it is good enough. ACCEL also queues repeated scenarios for
    /// an edit.
    fn observe(&mut self, settings: &Settings, outcome: &GroupOutcome, rng: &mut KeyedRng) {
        let Some(score) = score(settings, outcome) else {
            self.unscored = self.unscored.saturating_add(1);
            return;
        };
        let visit = Visit { score, mean_score: outcome.mean_score };
        let seq = outcome.scenario_proposal();
        match outcome.source {
            ScenarioSource::Replay { .. } => {
                self.scored.replayed = self.scored.replayed.saturating_add(1);
                let is_kept = self.buffer.record_visit(seq, visit);
                let may_edit =
                    settings.strategy == StrategyKind::Accel && self.edits.len() < MAX_QUEUED_EDITS;
                if is_kept && may_edit && rng.bernoulli(settings.hyperparameters.number(&EDITED)) {
                    self.edits.push_back(seq);
                }
            }
            ScenarioSource::Edited { of } => {
                self.scored.edited = self.scored.edited.saturating_add(1);
                let generation = self.buffer.get(of).map_or(0, |parent| parent.generation).saturating_add(1);
                let level = BufferedLevel::new(outcome.level, visit, generation);
                self.buffer.insert(seq, level, capacity(settings));
            }
            ScenarioSource::Fresh | ScenarioSource::Chosen { .. } => {
                self.scored.fresh = self.scored.fresh.saturating_add(1);
                let level = BufferedLevel::new(outcome.level, visit, 0);
                self.buffer.insert(seq, level, capacity(settings));
            }
        }
    }
}

impl From<[u64; 3]> for ScoredOutcomes {
    fn from([fresh, replayed, edited]: [u64; 3]) -> Self {
        Self { fresh, replayed, edited }
    }
}

impl From<ScoredOutcomes> for [u64; 3] {
    fn from(counts: ScoredOutcomes) -> Self {
        [counts.fresh, counts.replayed, counts.edited]
    }
}
