//! Ladder: moves up and down each task's level table on evidence. The default strategy.
//!
//! A placement finds the level at which a task starts ([`placement`]). After it, blocks of contested scenarios at the
//! current level decide whether the level moves ([`level_stage`]). Half of the proposals must be contested; the others
//! are used as drawn, so that the agent also learns when not to act. Some proposals rehearse lower levels, because
//! networks forget what they no longer meet (McCloskey and Cohen 1989) and repeating a little of it helps (Robins
//! 1995).

mod explain;
mod level_stage;
mod placement;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use self::level_stage::LevelStage;
use self::placement::{PROBE_SIZE, Placement, PlacementStep};
use crate::core::evidence::level_move::{LevelMove, MoveKind};
use crate::core::evidence::slot_queue::SlotQueue;
use crate::core::explanation::{Explanation, TaskStatus};
use crate::core::outcome::GroupOutcome;
use crate::core::proposal::{Proposal, ProposalRole};
use crate::core::settings::{Settings, Target, TaskPlan};
use crate::core::shares;
use crate::core::slot::Slot;
use crate::core::strategy::{Strategy, StrategyContext, StrategyState};

/// Number of levels below the current one that are rehearsed.
const REHEARSED_LEVELS: u32 = 4;

/// State of the ladder: the progress of each task.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Ladder {
    tasks: BTreeMap<String, TaskProgress>,
}

/// Progress of a task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct TaskProgress {
    /// Number of moves so far, steps of placement included.
    epoch: u32,
    stage: TaskStage,
    last_move: Option<LevelMove>,
}

/// Stage of a task: before or after its first level is set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum TaskStage {
    Placement(Placement),
    Level(LevelStage),
}

impl Strategy for Ladder {
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal {
        let mut rng = ctx.rng();
        let plan = shares::pick_task(ctx.settings, rng.uniform());
        let progress =
            (self.tasks.entry(plan.task.clone())).or_insert_with(|| TaskProgress::new(ctx.settings, plan));
        let epoch = progress.epoch;
        let (level, role, contested, why) = match &progress.stage {
            TaskStage::Placement(placement) => {
                let level = placement.level();
                let why = format!(
                    "placement probes level {level}: {} of {PROBE_SIZE} scenarios are in",
                    placement.filling.n
                );
                (level, ProposalRole::Placement, true, why)
            }
            TaskStage::Level(stage) => {
                let contested = rng.bernoulli(ctx.settings.contested_share);
                let at_frontier = rng.bernoulli(ctx.settings.frontier_share) || stage.level == 0;
                if at_frontier {
                    (stage.level, ProposalRole::Frontier, contested, stage.describe_frontier(contested))
                } else {
                    let level = stage.level - 1 - rng.below(stage.level.min(REHEARSED_LEVELS));
                    let why = format!("rehearsal of level {level}, below the current level {}", stage.level);
                    (level, ProposalRole::Rehearsal, contested, why)
                }
            }
        };
        Proposal { epoch, contested, why, ..Proposal::fresh(plan, Some(level), role) }
    }

    fn open_slot(&mut self, slot: &Slot, _ctx: &StrategyContext<'_>) {
        // A slot of an earlier epoch belongs to another level.
        if let Some(progress) = self.tasks.get_mut(&slot.task).filter(|progress| progress.epoch == slot.epoch)
        {
            progress.open_slot(slot);
        }
    }

    fn withdraw_slot(&mut self, slot: &Slot, ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        self.end_slot(&slot.task, ctx, |queue| queue.withdraw(slot.key()))
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        let Some(value) = outcome.evidence else { return Vec::new() };
        self.end_slot(&outcome.task, ctx, |queue| queue.resolve(outcome.slot_key(), value))
    }

    fn close_epoch(&mut self, task: &str, ctx: &StrategyContext<'_>) {
        if let (Some(plan), Some(progress)) = (ctx.settings.task(task), self.tasks.get_mut(task)) {
            progress.close_epoch(plan);
        }
    }

    fn change_settings(&mut self, restarted: &[&str], ctx: &StrategyContext<'_>) {
        self.tasks.retain(|task, _| ctx.settings.task(task).is_some());
        for plan in ctx.settings.tasks.iter().filter(|plan| restarted.contains(&plan.task.as_str())) {
            self.tasks.insert(plan.task.clone(), TaskProgress::new(ctx.settings, plan));
        }
    }

    fn epoch(&self, task: &str) -> u32 {
        self.tasks.get(task).map_or(0, |progress| progress.epoch)
    }

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        let known = settings.tasks.iter().filter_map(|plan| Some((plan, self.tasks.get(&plan.task)?)));
        known.map(|(plan, progress)| explain::task_status(progress, plan, settings.target)).collect()
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        explain::explain(self, settings)
    }
}

impl StrategyState for Ladder {
    const VERSION: u32 = 2;

    fn new(settings: &Settings) -> Self {
        let start = |plan: &TaskPlan| (plan.task.clone(), TaskProgress::new(settings, plan));
        Self { tasks: settings.tasks.iter().map(start).collect() }
    }

    fn resume(self, settings: &Settings) -> Result<Self, String> {
        for plan in &settings.tasks {
            let progress = self.tasks.get(&plan.task).ok_or_else(|| format!("{} is missing", plan.task))?;
            let hardest_level = plan.hardest_level();
            let fits = match &progress.stage {
                TaskStage::Placement(placement) => placement.fits(hardest_level),
                TaskStage::Level(stage) => stage.level <= hardest_level,
            };
            if !fits {
                return Err(format!(
                    "the level of {} is above the hardest level of its table, {hardest_level}",
                    plan.task
                ));
            }
        }
        Ok(self)
    }
}

impl TaskProgress {
    fn new(settings: &Settings, plan: &TaskPlan) -> Self {
        let stage = if settings.placement {
            TaskStage::Placement(Placement::new(plan.hardest_level()))
        } else {
            TaskStage::Level(LevelStage::default())
        };
        Self { epoch: 0, stage, last_move: None }
    }

    /// Adds a slot of this epoch to the probe or block that it counts for, if there is one.
    fn open_slot(&mut self, slot: &Slot) {
        match (&mut self.stage, slot.role) {
            (TaskStage::Placement(placement), ProposalRole::Placement)
                if slot.level == Some(placement.level()) =>
            {
                placement.queue.open(slot);
            }
            (TaskStage::Level(stage), ProposalRole::Frontier) if slot.level == Some(stage.level) => {
                stage.queue.open(slot);
            }
            _ => {}
        }
    }

    /// Slots that count for the current probe or block.
    const fn queue(&mut self) -> &mut SlotQueue {
        match &mut self.stage {
            TaskStage::Placement(placement) => &mut placement.queue,
            TaskStage::Level(stage) => &mut stage.queue,
        }
    }

    /// Drops the evidence that has not moved the level. The level stays; a placement starts again.
    fn close_epoch(&mut self, plan: &TaskPlan) {
        self.epoch = self.epoch.saturating_add(1);
        self.stage = match &self.stage {
            TaskStage::Placement(_) => TaskStage::Placement(Placement::new(plan.hardest_level())),
            TaskStage::Level(stage) => {
                TaskStage::Level(LevelStage { level: stage.level, ..LevelStage::default() })
            }
        };
    }

    /// Takes settled slots into account and returns the move they cause.
    fn settle(&mut self, plan: &TaskPlan, target: Target) -> Option<LevelMove> {
        let (kind, from, to, evidence) = match &mut self.stage {
            TaskStage::Placement(placement) => match placement.settle() {
                PlacementStep::SameLevel => return None,
                PlacementStep::NextLevel => {
                    self.epoch = self.epoch.saturating_add(1);
                    return None;
                }
                PlacementStep::Placed(level) => (MoveKind::Placement, None, level, placement.evidence(level)),
            },
            TaskStage::Level(stage) => {
                let from = stage.level;
                let step = stage.settle(target, plan.hardest_level())?;
                let to = if step.kind == MoveKind::Up { from + 1 } else { from - 1 };
                (step.kind, Some(from), to, step.evidence)
            }
        };
        self.epoch = self.epoch.saturating_add(1);
        self.stage = TaskStage::Level(LevelStage { level: to, ..LevelStage::default() });
        let made = LevelMove { task: plan.task.clone(), kind, from, to, evidence };
        self.last_move = Some(made.clone());
        Some(made)
    }
}

impl Ladder {
    /// Ends a slot by `end`, which says whether the queue had it, and returns the moves that follow.
    fn end_slot(
        &mut self,
        task: &str,
        ctx: &StrategyContext<'_>,
        end: impl FnOnce(&mut SlotQueue) -> bool,
    ) -> Vec<LevelMove> {
        let (Some(plan), Some(progress)) = (ctx.settings.task(task), self.tasks.get_mut(task)) else {
            return Vec::new();
        };
        if !end(progress.queue()) {
            return Vec::new();
        }
        progress.settle(plan, ctx.settings.target).into_iter().collect()
    }
}
