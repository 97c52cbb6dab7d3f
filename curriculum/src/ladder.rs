//! Ladder: climbs each task's table of levels, on evidence. The default strategy.
//!
//! Per task: a placement finds where to start ([`super::placement`]), then blocks of contested scenarios at the current
//! level decide where to go ([`super::block`]). Half of the proposals are contested by choice, half as they come, so
//! that patience is trained too; some rehearse levels already passed, because networks forget what they no longer meet
//! (McCloskey and Cohen 1989) and replaying a little of it helps (Robins 1995).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::block::{BLOCK, Discarded, Tally, Verdict, verdict};
use super::event::{Evidence, GroupOutcome, Move, MoveKind, Proposal, Role};
use super::explain::{Explanation, TaskStatus};
use super::placement::{PROBE, Placement, Step};
use super::settings::{Settings, Target, TaskPlan};
use super::shares;
use super::strategy::{Context, Strategy};

mod words;

const VERSION: u32 = 1;

/// Levels below the current one that are rehearsed.
const REHEARSED: u32 = 4;

/// Where each task stands.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Ladder {
    tasks: BTreeMap<String, Climb>,
}

/// Where a task stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Climb {
    /// Moves so far, steps of placement included.
    epoch: u32,
    stage: Stage,
    last_move: Option<Move>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Stage {
    Placing(Placement),
    Climbing(Rung),
}

/// The current level and its blocks since the last move.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Rung {
    level: u32,
    filling: Tally,
    /// The last full block that counted.
    last: Option<Tally>,
    /// Full blocks that counted.
    blocks: u32,
    discarded: Discarded,
}

impl Ladder {
    pub(super) fn new(settings: &Settings) -> Self {
        let start = |plan: &TaskPlan| (plan.task.clone(), Climb::new(settings, plan));
        Self { tasks: settings.tasks.iter().map(start).collect() }
    }

    /// Reads a state and checks that it is one of these tasks and tables.
    pub(super) fn restore(settings: &Settings, state: &Value) -> Result<Self, String> {
        let ladder = Self::deserialize(state).map_err(|error| error.to_string())?;
        for plan in &settings.tasks {
            let climb = ladder.tasks.get(&plan.task).ok_or_else(|| format!("{} is missing", plan.task))?;
            let fits = match &climb.stage {
                Stage::Placing(placement) => placement.fits(plan.top()),
                Stage::Climbing(rung) => rung.level <= plan.top(),
            };
            if !fits {
                return Err(format!("{} stands above the top of its table, {}", plan.task, plan.top()));
            }
        }
        Ok(ladder)
    }
}

impl Strategy for Ladder {
    fn propose(&mut self, ctx: &Context<'_>) -> Proposal {
        let mut draws = ctx.draws();
        let plan = shares::pick(ctx.settings, draws.uniform());
        let climb = self.tasks.entry(plan.task.clone()).or_insert_with(|| Climb::new(ctx.settings, plan));
        let (level, role, contested, why) = match &climb.stage {
            Stage::Placing(placement) => {
                let level = placement.level();
                let why = format!(
                    "placement probes level {level}: {} of {PROBE} scenarios are in",
                    placement.filling.n
                );
                (level, Role::Placement, true, why)
            }
            Stage::Climbing(rung) => {
                let contested = draws.chance(ctx.settings.contested_share);
                let frontier = draws.chance(ctx.settings.frontier_share) || rung.level == 0;
                if frontier {
                    (rung.level, Role::Frontier, contested, rung.why_frontier(contested))
                } else {
                    let level = rung.level - 1 - draws.below(rung.level.min(REHEARSED));
                    let why = format!("rehearsal of level {level}, below the current level {}", rung.level);
                    (level, Role::Rehearsal, contested, why)
                }
            }
        };
        Proposal { epoch: climb.epoch, contested, why, ..Proposal::at(plan, Some(level), role) }
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &Context<'_>) -> Vec<Move> {
        let (Some(plan), Some(climb)) = (ctx.settings.task(&outcome.task), self.tasks.get_mut(&outcome.task))
        else {
            return Vec::new();
        };
        // What is not contested says little, and what was proposed before the last move speaks of another level.
        if !(outcome.evidence && outcome.contested && outcome.epoch == climb.epoch) {
            return Vec::new();
        }
        climb.observe(outcome, plan, ctx.settings.target).into_iter().collect()
    }

    fn adopt(&mut self, afresh: &[&str], ctx: &Context<'_>) {
        self.tasks.retain(|task, _| ctx.settings.task(task).is_some());
        for plan in ctx.settings.tasks.iter().filter(|plan| afresh.contains(&plan.task.as_str())) {
            self.tasks.insert(plan.task.clone(), Climb::new(ctx.settings, plan));
        }
    }

    fn epoch(&self, task: &str) -> u32 {
        self.tasks.get(task).map_or(0, |climb| climb.epoch)
    }

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        let known = settings.tasks.iter().filter_map(|plan| Some((plan, self.tasks.get(&plan.task)?)));
        known.map(|(plan, climb)| climb.status(plan, settings.target)).collect()
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

impl Climb {
    fn new(settings: &Settings, plan: &TaskPlan) -> Self {
        let stage = if settings.placement {
            Stage::Placing(Placement::new(plan.top()))
        } else {
            Stage::Climbing(Rung::default())
        };
        Self { epoch: 0, stage, last_move: None }
    }

    /// Takes contested evidence of this epoch.
    fn observe(&mut self, outcome: &GroupOutcome, plan: &TaskPlan, target: Target) -> Option<Move> {
        let (kind, from, to, evidence) = match (&mut self.stage, outcome.role) {
            (Stage::Placing(placement), Role::Placement) if outcome.level == Some(placement.level()) => {
                match placement.take(outcome) {
                    Step::Same => return None,
                    Step::Next => {
                        self.epoch += 1;
                        return None;
                    }
                    Step::Placed(level) => (MoveKind::Placement, None, level, placement.evidence(level)),
                }
            }
            (Stage::Climbing(rung), Role::Frontier) if outcome.level == Some(rung.level) => {
                let from = rung.level;
                let (kind, evidence) = rung.take(outcome, target, plan.top())?;
                (kind, Some(from), if kind == MoveKind::Up { from + 1 } else { from - 1 }, evidence)
            }
            _ => return None,
        };
        self.epoch += 1;
        self.stage = Stage::Climbing(Rung { level: to, ..Rung::default() });
        let made = Move { task: plan.task.clone(), kind, from, to, evidence };
        self.last_move = Some(made.clone());
        Some(made)
    }
}

impl Rung {
    /// Takes a contested outcome of the current level; the move it causes. At the ends of the table blocks simply go
    /// on.
    fn take(&mut self, outcome: &GroupOutcome, target: Target, top: u32) -> Option<(MoveKind, Evidence)> {
        self.filling.take(outcome);
        if self.filling.n < BLOCK {
            return None;
        }
        let full = std::mem::take(&mut self.filling);
        if full.lossy() {
            self.discarded.add(&full);
            return None;
        }
        self.blocks = self.blocks.saturating_add(1);
        let before = self.last.replace(full);
        let kind = match verdict(target, before.as_ref(), &full) {
            Verdict::Up if self.level < top => MoveKind::Up,
            Verdict::Down if self.level > 0 => MoveKind::Down,
            _ => return None,
        };
        let blocks = match target {
            Target::Mastery => before.into_iter().chain([full]).collect(),
            Target::Half => vec![full],
        };
        Some((kind, words::evidence(kind, target, &blocks)))
    }

    fn why_frontier(&self, contested: bool) -> String {
        let how = if contested { "contested" } else { "as it comes" };
        format!(
            "the current level {}, {how}: {} of {BLOCK} scenarios of block {} are in",
            self.level,
            self.filling.n,
            self.blocks + 1
        )
    }
}
