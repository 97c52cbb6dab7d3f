//! PLR, robust PLR and ACCEL: scenarios that the agent falls short on are faced again, and edited.
//!
//! Prioritized level replay (Jiang, Grefenstette, Rocktäschel 2021): what is drawn is scored, the best are kept, and most of the time
//! one of them is faced again, by the rank of its score and by how long ago that was. Robust PLR (Jiang et al. 2021b) learns from
//! those alone, so that what it learns from is chosen by regret. ACCEL (Parker-Holder et al. 2022) edits what it replays: small
//! changes of scenarios at the frontier are at the frontier, too.
//!
//! Of each task there is a shelf of its own ([`shelf`]), so that no task starves.

mod shelf;
mod words;

use std::collections::{BTreeMap, VecDeque};

use env_core::Draws;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use self::shelf::{Entry, Ranks, Shelf, Visit};
use super::event::{GroupOutcome, Move, Proposal, Role, Source};
use super::explain::{Explanation, TaskStatus};
use super::kind::StrategyKind;
use super::settings::{Settings, TaskPlan};
use super::shares;
use super::strategy::{Context, Strategy};
use super::tuning::{Hyper, Range};

const VERSION: u32 = 1;

/// Edits that wait for their turn, at most.
const EDITS: usize = 64;

pub(super) const REPLAY: Hyper = Hyper {
    name: "replay",
    range: Range::Number { default: 0.8, min: 0.0, max: 1.0 },
    about: "how often a scenario that is kept is faced again, once there are enough",
    source: "Parker-Holder et al. 2022, table 6",
};
pub(super) const SCORE: Hyper = Hyper {
    name: "score",
    range: Range::Word(&["regret", "learnability", "positive_value_loss", "max_mc"]),
    about: "what a scenario has to teach: max(0, reference − score)/(reference − floor); k(L − k)/(L(L − 1)) of k successes in L \
            episodes; or what the trainer reports with its results",
    source: "the planner's reference is a lower bound on the best; Rutherford et al. 2024; Jiang et al. 2021 and 2021b",
};
pub(super) const BETA: Hyper = Hyper {
    name: "beta",
    range: Range::Number { default: 0.3, min: 0.01, max: 10.0 },
    about: "temperature of the draw by rank: the smaller, the more the first are drawn",
    source: "Jiang et al. 2021b, table 3",
};
pub(super) const STALENESS: Hyper = Hyper {
    name: "staleness",
    range: Range::Number { default: 0.3, min: 0.0, max: 1.0 },
    about: "share of draws by how long ago a scenario was proposed, so that scores do not age",
    source: "Jiang et al. 2021b, table 3",
};
pub(super) const CAPACITY: Hyper = Hyper {
    name: "capacity",
    range: Range::Whole { default: 4000, min: 1, max: 100_000 },
    about: "scenarios kept, of all tasks together",
    source: "Jiang et al. 2021b, table 3",
};
pub(super) const FILLED: Hyper = Hyper {
    name: "filled",
    range: Range::Whole { default: 64, min: 1, max: 100_000 },
    about: "scenarios kept of a task from which on they are faced again",
    source: "ours: the half of the capacity that is usual would be days of a language model's episodes",
};
pub(super) const EDITED: Hyper = Hyper {
    name: "edited",
    range: Range::Number { default: 1.0, min: 0.0, max: 1.0 },
    about: "how often a scenario that was faced again is edited",
    source: "Parker-Holder et al. 2022, algorithm 1",
};

pub(super) const PLR: &[Hyper] = &[REPLAY, SCORE, BETA, STALENESS, CAPACITY, FILLED];
pub(super) const ACCEL: &[Hyper] = &[REPLAY, SCORE, BETA, STALENESS, CAPACITY, FILLED, EDITED];

/// The shelves of a run.
#[derive(Debug, Clone)]
pub(super) struct Replay {
    tasks: BTreeMap<String, Task>,
    ranks: Ranks,
}

/// What is known of a task.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Task {
    shelf: Shelf,
    /// Scenarios to be edited, the first first.
    edits: VecDeque<u64>,
    /// Outcomes of scenarios as they are drawn, of those faced again, and of edits.
    seen: [u64; 3],
    /// Outcomes without what they are scored by.
    unscored: u64,
}

impl Replay {
    pub(super) fn new(settings: &Settings) -> Self {
        Self { tasks: BTreeMap::new(), ranks: Ranks::new(settings.tuning.number(&BETA)) }
    }

    pub(super) fn restore(settings: &Settings, state: &Value) -> Result<Self, serde_json::Error> {
        Ok(Self { tasks: BTreeMap::deserialize(state)?, ..Self::new(settings) })
    }

    /// What an outcome says its scenario has to teach.
    fn worth(settings: &Settings, outcome: &GroupOutcome) -> Option<f64> {
        let told = match settings.tuning.word(&SCORE) {
            "learnability" => outcome.learnability(),
            "positive_value_loss" => outcome.signals.positive_value_loss,
            "max_mc" => outcome.signals.max_mc,
            _ => outcome.signals.regret,
        };
        told.filter(|worth| worth.is_finite())
    }
}

/// Scenarios that may be kept of a task.
fn capacity(settings: &Settings) -> usize {
    (settings.tuning.whole(&CAPACITY) as usize / settings.tasks.len().max(1)).max(1)
}

/// Whether what is drawn is trained on, too.
fn trains_on_all(settings: &Settings) -> bool {
    settings.strategy == StrategyKind::Plr
}

impl Task {
    /// A scenario nobody has seen.
    fn fresh(settings: &Settings, plan: &TaskPlan, draws: &mut Draws) -> Proposal {
        let level = draws.below(plan.top() + 1);
        let contested = draws.chance(settings.contested_share);
        let train = trains_on_all(settings);
        let why = match train {
            true => format!("level {level}, drawn uniformly, to see what it has to teach"),
            false => {
                format!("level {level}, drawn uniformly, to see what it has to teach; not to be learnt from")
            }
        };
        Proposal { contested, train, why, ..Proposal::at(plan, Some(level), Role::Explore) }
    }

    /// The next edit, if its parent is still there.
    fn edit(&mut self, plan: &TaskPlan) -> Option<Proposal> {
        while let Some(of) = self.edits.pop_front() {
            let Some(entry) = self.shelf.get(of) else { continue };
            let why = format!(
                "an edit of the scenario of proposal {of}, whose worth is {:.2} over {} visits",
                entry.worth, entry.visits
            );
            let source = Source::Edited { of };
            return Some(Proposal {
                source,
                train: false,
                why,
                ..Proposal::at(plan, entry.level, Role::Edit)
            });
        }
        None
    }

    fn again(
        &mut self,
        settings: &Settings,
        plan: &TaskPlan,
        (draws, ranks): (&mut Draws, &mut Ranks),
        now: u64,
    ) -> Option<Proposal> {
        let enough = self.shelf.len() >= (settings.tuning.whole(&FILLED) as usize).min(capacity(settings));
        if !(enough && draws.chance(settings.tuning.number(&REPLAY))) {
            return None;
        }
        let of = self.shelf.draw(draws, ranks, (now, settings.tuning.number(&STALENESS)))?;
        let entry = *self.shelf.get(of)?;
        self.shelf.proposed(of, now);
        let why = format!(
            "the scenario of proposal {of} again: its worth is {:.2} over {} visits{}",
            entry.worth,
            entry.visits,
            if entry.generation > 0 {
                format!(", an edit of generation {}", entry.generation)
            } else {
                String::new()
            }
        );
        Some(Proposal { source: Source::Again { of }, why, ..Proposal::at(plan, entry.level, Role::Replay) })
    }

    fn observe(&mut self, settings: &Settings, outcome: &GroupOutcome, draws: &mut Draws) {
        let Some(worth) = Replay::worth(settings, outcome) else {
            self.unscored += 1;
            return;
        };
        let visit = Visit { worth, score: outcome.mean_score };
        let id = outcome.made_by();
        match outcome.source {
            Source::Again { .. } => {
                self.seen[1] += 1;
                let there = self.shelf.visit(id, visit);
                let edits = settings.strategy == StrategyKind::Accel && self.edits.len() < EDITS;
                if there && edits && draws.chance(settings.tuning.number(&EDITED)) {
                    self.edits.push_back(id);
                }
            }
            Source::Edited { of } => {
                self.seen[2] += 1;
                let generation = self.shelf.get(of).map_or(0, |parent| parent.generation) + 1;
                self.shelf.add(id, Entry::seen(outcome.level, visit, generation), capacity(settings));
            }
            Source::Fresh | Source::Chosen { .. } => {
                self.seen[0] += 1;
                self.shelf.add(id, Entry::seen(outcome.level, visit, 0), capacity(settings));
            }
        }
    }
}

impl Strategy for Replay {
    fn propose(&mut self, ctx: &Context<'_>) -> Proposal {
        let (mut draws, settings) = (ctx.draws(), ctx.settings);
        let plan = shares::pick(settings, draws.uniform());
        let task = self.tasks.entry(plan.task.clone()).or_default();
        let draws = &mut draws;
        task.edit(plan)
            .or_else(|| task.again(settings, plan, (draws, &mut self.ranks), ctx.seq))
            .unwrap_or_else(|| Task::fresh(settings, plan, draws))
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &Context<'_>) -> Vec<Move> {
        if outcome.evidence && outcome.finished > 0 {
            let task = self.tasks.entry(outcome.task.clone()).or_default();
            task.observe(ctx.settings, outcome, &mut ctx.draws());
        }
        Vec::new()
    }

    fn adopt(&mut self, afresh: &[&str], ctx: &Context<'_>) {
        self.ranks = Ranks::new(ctx.settings.tuning.number(&BETA));
        self.tasks.retain(|task, _| ctx.settings.task(task).is_some() && !afresh.contains(&task.as_str()));
        for task in self.tasks.values_mut() {
            task.shelf.shrink(capacity(ctx.settings));
        }
    }

    fn held(&self) -> Vec<u64> {
        self.tasks.values().flat_map(|task| task.shelf.entries().map(|(seq, _)| seq)).collect()
    }

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        words::status(self, settings)
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        words::explain(self, settings)
    }

    fn snapshot(&self) -> Value {
        serde_json::to_value(&self.tasks).expect("a state of finite numbers and string keys has a JSON form")
    }

    fn version(&self) -> u32 {
        VERSION
    }

    fn boxed_clone(&self) -> Box<dyn Strategy> {
        Box::new(self.clone())
    }
}
