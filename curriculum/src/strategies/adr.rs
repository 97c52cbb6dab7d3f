//! Automatic domain randomisation: each param is drawn between its easiest value and a bound that adapts.
//!
//! Follows Akkaya et al. (2019, "Solving Rubik's Cube with a robot hand", section 5 and algorithm 1), with some
//! changes. A share of the proposals holds one param at its bound and draws the others within theirs. Once a buffer of
//! these is full, the bound widens if they succeed often even if every missing episode failed, and narrows if they
//! succeed rarely even if every missing episode succeeded. A bound is a position on
//! the task's [`LevelScale`], so that one step means about the same for each param; the easy ends are fixed.

use std::collections::BTreeMap;

use env_core::KeyedRng;
use serde::{Deserialize, Serialize};

use crate::core::evidence::block::{EvidenceBlock, format_count};
use crate::core::evidence::level_move::LevelMove;
use crate::core::evidence::slot_queue::SlotQueue;
use crate::core::explanation::{Explanation, TaskStatus};
use crate::core::outcome::GroupOutcome;
use crate::core::proposal::{Proposal, ProposalRole};
use crate::core::sampler_state::SamplerOutlook;
use crate::core::scale::LevelScale;
use crate::core::settings::hyperparameters::adr::{BOUNDARY, BUFFER, NARROW, STEP, WIDEN};
use crate::core::settings::{Hyperparameters, Settings, TaskPlan};
use crate::core::shares;
use crate::core::slot::{Slot, SlotKey};
use crate::core::strategy::{Strategy, StrategyContext, StrategyState, drop_stale_tasks};

/// State of ADR: the bounds of each task, one for each axis of its level scale.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Adr {
    tasks: BTreeMap<String, Vec<ParamBound>>,
}

/// Upper bound of a param.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct ParamBound {
    /// Position of the bound on the level scale.
    position: f64,
    /// Number of moves of the bound so far.
    moves: u32,
    /// Seq of the last move. Proposals made before it held the param at another position and fill no buffer.
    since: u64,
    /// Slots at the bound that are not settled.
    queue: SlotQueue,
    filling: EvidenceBlock,
    /// The last buffer that was full.
    #[serde(default)]
    last_full: Option<EvidenceBlock>,
}

impl Strategy for Adr {
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal {
        let mut rng = ctx.rng();
        let plan = shares::pick_task(ctx.settings, rng.uniform());
        let scale = LevelScale::new(plan);
        let boundary_axis = draw_boundary_axis(&mut rng, ctx.settings, scale.len());
        let bounds = self.tasks.entry(plan.task.clone()).or_insert_with(|| initial_bounds(plan));
        let mut positions: Vec<f64> = bounds.iter().map(|bound| bound.position * rng.uniform()).collect();
        let (role, contested, why) = match boundary_axis {
            Some(axis) => {
                let (bound, name) = (&bounds[axis], scale.names().nth(axis).unwrap_or_default());
                positions[axis] = bound.position;
                let why = format!(
                    "{name} at its bound, {:.1} of {}: {} of {} scenarios are in",
                    bound.position,
                    plan.hardest_level(),
                    bound.filling.n,
                    ctx.settings.hyperparameters.integer(&BUFFER)
                );
                (ProposalRole::Boundary, true, why)
            }
            None => {
                let contested = rng.bernoulli(ctx.settings.contested_share);
                (ProposalRole::Sample, contested, "each param drawn within its bound".to_owned())
            }
        };
        Proposal { contested, why, params: scale.params(&positions), ..Proposal::fresh(plan, None, role) }
    }

    fn open_slot(&mut self, slot: &Slot, ctx: &StrategyContext<'_>) {
        if slot.role == ProposalRole::Boundary
            && let Some(bound) = self.bound(&slot.task, slot.proposal, ctx)
            && slot.proposal >= bound.since
        {
            bound.queue.open(slot);
        }
    }

    fn withdraw_slot(&mut self, slot: &Slot, ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        self.end_slot(&slot.task, slot.key(), ctx, |queue| queue.withdraw(slot.key()));
        Vec::new()
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        if let Some(value) = outcome.evidence {
            let key = outcome.slot_key();
            self.end_slot(&outcome.task, key, ctx, |queue| queue.resolve(key, value));
        }
        Vec::new()
    }

    fn close_epoch(&mut self, task: &str, ctx: &StrategyContext<'_>) {
        for bound in self.tasks.get_mut(task).into_iter().flatten() {
            *bound = ParamBound {
                since: ctx.seq,
                position: bound.position,
                moves: bound.moves,
                ..ParamBound::default()
            };
        }
    }

    fn change_settings(&mut self, restarted: &[&str], ctx: &StrategyContext<'_>) {
        drop_stale_tasks(&mut self.tasks, restarted, ctx);
    }

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        settings.tasks.iter().map(|plan| self.task_status(plan, settings)).collect()
    }

    fn sampler(&self, _plan: &TaskPlan, _ctx: &StrategyContext<'_>) -> SamplerOutlook {
        SamplerOutlook::of_params()
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        let rules = vec![
            "Tasks share the proposals by weight, each at least 5 %.".to_owned(),
            format!(
                "{:.0} % of the proposals hold one param at its bound, on a contested scenario, and draw \
                 the others within theirs; the rest draw all params within their bounds.",
                100.0 * settings.hyperparameters.number(&BOUNDARY)
            ),
            "A full buffer of such scenarios widens, narrows or keeps the bound. A missing episode counts as \
             a failure for widening, and as a success for narrowing."
                .to_owned(),
        ];
        let summary =
            "Each param is drawn between its easiest value and a bound that adapts to the agent's success.";
        Explanation::without_levels(settings, Self::VERSION, summary, rules, |plan| self.describe_task(plan))
    }
}

impl StrategyState for Adr {
    const VERSION: u32 = 2;

    fn new(_settings: &Settings) -> Self {
        Self::default()
    }

    fn resume(self, settings: &Settings) -> Result<Self, String> {
        for plan in &settings.tasks {
            let axes = LevelScale::new(plan).len();
            if self.tasks.get(&plan.task).is_some_and(|bounds| bounds.len() != axes) {
                return Err(format!("the params of {} differ from its table", plan.task));
            }
        }
        Ok(self)
    }
}

impl Adr {
    /// Bound that a proposal was at. The proposal's draws are repeated up to its axis, which is therefore not stored.
    fn bound(&mut self, task: &str, proposal: u64, ctx: &StrategyContext<'_>) -> Option<&mut ParamBound> {
        let plan = ctx.settings.task(task)?;
        let mut rng = StrategyContext { seq: proposal, ..*ctx }.rng();
        let _task_draw = rng.uniform();
        let axis = draw_boundary_axis(&mut rng, ctx.settings, LevelScale::new(plan).len())?;
        self.tasks.entry(plan.task.clone()).or_insert_with(|| initial_bounds(plan)).get_mut(axis)
    }

    /// Ends a slot by `end`, which says whether the queue had it, and moves the bound by the slots that are settled.
    fn end_slot(
        &mut self,
        task: &str,
        key: SlotKey,
        ctx: &StrategyContext<'_>,
        end: impl FnOnce(&mut SlotQueue) -> bool,
    ) {
        let Some(plan) = ctx.settings.task(task) else { return };
        let last_position = LevelScale::new(plan).last_position();
        if let Some(bound) = self.bound(task, key.proposal, ctx)
            && end(&mut bound.queue)
        {
            bound.settle(ctx, last_position);
        }
    }

    fn bounds(&self, plan: &TaskPlan) -> Vec<ParamBound> {
        self.tasks.get(&plan.task).cloned().unwrap_or_else(|| initial_bounds(plan))
    }

    /// Status of a task; its params are those at the bounds.
    fn task_status(&self, plan: &TaskPlan, settings: &Settings) -> TaskStatus {
        let (scale, bounds) = (LevelScale::new(plan), self.bounds(plan));
        let positions: Vec<f64> = bounds.iter().map(|bound| bound.position).collect();
        let earliest = bounds.iter().flat_map(|bound| [bound.filling.first, bound.queue.earliest_proposal()]);
        let held_back = bounds.iter().zip(scale.names()).find_map(|(bound, name)| {
            let is_hardest = bound.position >= scale.last_position();
            bound.held_back(&settings.hyperparameters, name).filter(|_| !is_hardest)
        });
        TaskStatus {
            held_back,
            earliest_proposal: earliest.flatten().min(),
            ..TaskStatus::without_levels(&plan.task, scale.params(&positions))
        }
    }

    fn describe_task(&self, plan: &TaskPlan) -> String {
        let scale = LevelScale::new(plan);
        let describe = |(bound, name): (ParamBound, &str)| {
            let last =
                bound.last_full.map_or_else(String::new, |full| format!(", last {:.2}", full.mean_low()));
            let top = plan.hardest_level();
            format!("{name} to row {:.1} of {top} ({} moves{last})", bound.position, bound.moves)
        };
        self.bounds(plan).into_iter().zip(scale.names()).map(describe).collect::<Vec<_>>().join(", ")
    }
}

/// Bounds at which a task starts: each param at its easiest value.
fn initial_bounds(plan: &TaskPlan) -> Vec<ParamBound> {
    vec![ParamBound::default(); LevelScale::new(plan).len()]
}

/// Draws which axis a proposal holds at its bound, if any. A function of the generator's state alone, so that
/// `observe` can repeat it.
fn draw_boundary_axis(rng: &mut KeyedRng, settings: &Settings, axes: usize) -> Option<usize> {
    let is_boundary = rng.bernoulli(settings.hyperparameters.number(&BOUNDARY));
    let axis = rng.below(u32::try_from(axes).unwrap_or(u32::MAX)) as usize;
    (is_boundary && axes > 0).then_some(axis)
}

impl ParamBound {
    /// Moves settled slots into the buffer. A full buffer widens, narrows or keeps the bound, up to `last_position`.
    fn settle(&mut self, ctx: &StrategyContext<'_>, last_position: f64) {
        let size = ctx.settings.hyperparameters.integer(&BUFFER);
        while let Some(settled) = self.queue.next_settled() {
            if let Some(full) = self.filling.record_until_full(settled, size) {
                self.judge(&full, ctx, last_position);
            }
        }
    }

    /// Sentence that says why the bound does not widen although results are there, if missing results are the reason.
    fn held_back(&self, hyperparameters: &Hyperparameters, name: &str) -> Option<String> {
        let size = hyperparameters.integer(&BUFFER);
        let is_missing = |full: &EvidenceBlock| {
            let needed = hyperparameters.number(&WIDEN);
            full.mean_low() < needed && full.mean_high() >= needed
        };
        let missing_hold = |full: EvidenceBlock| {
            format!(
                "{} of {} outcomes of the last buffer at the bound of {name} are missing: the worst case has a mean \
                 of {:.2}, {:.2} is needed",
                format_count(full.missing()),
                full.n,
                full.mean_low(),
                hyperparameters.number(&WIDEN)
            )
        };
        self.queue.waiting_hold(size).or_else(|| self.last_full.filter(is_missing).map(missing_hold))
    }

    fn judge(&mut self, full: &EvidenceBlock, ctx: &StrategyContext<'_>, last_position: f64) {
        let hyperparameters = &ctx.settings.hyperparameters;
        let step = hyperparameters.number(&STEP);
        self.last_full = Some(*full);
        let position = if full.mean_low() >= hyperparameters.number(&WIDEN) {
            (self.position + step).min(last_position)
        } else if full.mean_high() <= hyperparameters.number(&NARROW) {
            (self.position - step).max(0.0)
        } else {
            self.position
        };
        if (position - self.position).abs() > 0.0 {
            self.moves = self.moves.saturating_add(1);
            (self.position, self.since, self.queue) = (position, ctx.seq, SlotQueue::default());
        }
    }
}
