//! Automatic domain randomisation: each param is drawn between its easiest value and a bound that moves by itself.
//!
//! As in Akkaya et al. (2019, "Solving Rubik's Cube with a robot hand", section 5 and algorithm 1), with what is ours: every other
//! proposal puts one param at its bound and draws the others within theirs; when as many of these as fill a buffer are in, the bound
//! widens where they succeed often, and narrows where they succeed seldom. A bound is a place in the task's table
//! ([`super::scale`]), so that a step means about as much for each param, and the easy ends stay where they are.

use std::collections::BTreeMap;

use env_core::Draws;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::block::{Discarded, Tally, loss_warnings};
use super::event::{GroupOutcome, Move, Proposal, Role};
use super::explain::{Explanation, TaskStatus};
use super::scale::Scale;
use super::settings::{Settings, TaskPlan};
use super::shares;
use super::strategy::{Context, Strategy};
use super::tuning::{Hyper, Range};

const VERSION: u32 = 1;

pub(super) const BOUNDARY: Hyper = Hyper {
    name: "boundary",
    range: Range::Number { default: 0.5, min: 0.0, max: 1.0 },
    about: "share of proposals with one param at its bound",
    source: "Akkaya et al. 2019, p_r",
};
pub(super) const BUFFER: Hyper = Hyper {
    name: "buffer",
    range: Range::Whole { default: 32, min: 4, max: 10_000 },
    about: "contested scenarios at a bound after which it may move",
    source: "a block of the ladder; Akkaya et al. 2019 have 240 episodes",
};
pub(super) const WIDEN: Hyper = Hyper {
    name: "widen",
    range: Range::Number { default: 0.7, min: 0.0, max: 1.0 },
    about: "mean success from which a bound widens",
    source: "the ladder's threshold; Akkaya et al. 2019 count successes of 50, at least 20",
};
pub(super) const NARROW: Hyper = Hyper {
    name: "narrow",
    range: Range::Number { default: 0.3, min: 0.0, max: 1.0 },
    about: "mean success up to which a bound narrows",
    source: "the ladder's threshold; Akkaya et al. 2019 count successes of 50, at most 10",
};
pub(super) const STEP: Hyper = Hyper {
    name: "step",
    range: Range::Number { default: 0.5, min: 0.01, max: 10.0 },
    about: "rows of the table by which a bound moves",
    source: "ours: Akkaya et al. 2019 choose a step for each param by hand",
};

pub(super) const HYPERS: &[Hyper] = &[BOUNDARY, BUFFER, WIDEN, NARROW, STEP];

/// The bounds of each task.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Adr {
    tasks: BTreeMap<String, Vec<Bound>>,
}

/// The bound of a param.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Bound {
    /// Its place in the table.
    place: f64,
    /// Moves so far: what was proposed before the last one fills no buffer.
    moves: u32,
    /// The seq before which its buffer's proposals were made, at another place.
    since: u64,
    filling: Tally,
    discarded: Discarded,
    /// Mean of the last full buffer.
    last: Option<f64>,
}

impl Adr {
    pub(super) fn restore(settings: &Settings, state: &Value) -> Result<Self, String> {
        let adr = Self::deserialize(state).map_err(|error| error.to_string())?;
        for plan in &settings.tasks {
            let (wanted, scale) = (Scale::of(plan).len(), adr.tasks.get(&plan.task));
            if scale.is_some_and(|bounds| bounds.len() != wanted) {
                return Err(format!("{} has other params than its table", plan.task));
            }
        }
        Ok(adr)
    }

    fn bounds(&mut self, plan: &TaskPlan) -> &mut Vec<Bound> {
        let fresh = || vec![Bound::default(); Scale::of(plan).len()];
        self.tasks.entry(plan.task.clone()).or_insert_with(fresh)
    }
}

/// Whether a proposal is at a bound, and which: drawn again, it is the same, so that it need not be stored.
fn axis(draws: &mut Draws, settings: &Settings, axes: usize) -> Option<usize> {
    let boundary = draws.chance(settings.tuning.number(&BOUNDARY));
    let axis = draws.below(u32::try_from(axes).unwrap_or(u32::MAX)) as usize;
    (boundary && axes > 0).then_some(axis)
}

impl Bound {
    /// Takes an outcome at the bound; whether it moved.
    fn take(&mut self, outcome: &GroupOutcome, settings: &Settings, (top, seq): (f64, u64)) {
        self.filling.take(outcome);
        if self.filling.n < settings.tuning.whole(&BUFFER) {
            return;
        }
        let full = std::mem::take(&mut self.filling);
        if full.lossy() {
            self.discarded.add(&full);
            return;
        }
        let (mean, step) = (full.mean(), settings.tuning.number(&STEP));
        self.last = Some(mean);
        let place = if mean >= settings.tuning.number(&WIDEN) {
            (self.place + step).min(top)
        } else if mean <= settings.tuning.number(&NARROW) {
            (self.place - step).max(0.0)
        } else {
            self.place
        };
        if (place - self.place).abs() > 0.0 {
            self.moves = self.moves.saturating_add(1);
            (self.place, self.since, self.discarded) = (place, seq, Discarded::default());
        }
    }
}

impl Strategy for Adr {
    fn propose(&mut self, ctx: &Context<'_>) -> Proposal {
        let mut draws = ctx.draws();
        let plan = shares::pick(ctx.settings, draws.uniform());
        let scale = Scale::of(plan);
        let at = axis(&mut draws, ctx.settings, scale.len());
        let bounds = self.bounds(plan);
        let mut places: Vec<f64> = bounds.iter().map(|bound| bound.place * draws.uniform()).collect();
        let name = at.and_then(|at| scale.names().nth(at)).unwrap_or_default();
        let (role, contested, why) = match at {
            Some(at) => {
                let bound = bounds[at];
                places[at] = bound.place;
                let of = ctx.settings.tuning.whole(&BUFFER);
                let (place, top) = (bound.place, plan.top());
                let why = format!(
                    "{name} at its bound, {place:.1} of {top}: {} of {of} scenarios are in",
                    bound.filling.n
                );
                (Role::Boundary, true, why)
            }
            None => {
                let contested = draws.chance(ctx.settings.contested_share);
                (Role::Sample, contested, "each param drawn within its bound".to_owned())
            }
        };
        Proposal { contested, why, params: scale.params(&places), ..Proposal::at(plan, None, role) }
    }

    fn observe(&mut self, outcome: &GroupOutcome, ctx: &Context<'_>) -> Vec<Move> {
        let Some(plan) = ctx.settings.task(&outcome.task) else { return Vec::new() };
        if !(outcome.evidence && outcome.contested && outcome.role == Role::Boundary) {
            return Vec::new();
        }
        let scale = Scale::of(plan);
        let mut draws = Context { seq: outcome.proposal, ..*ctx }.draws();
        let _task = draws.uniform();
        let Some(at) = axis(&mut draws, ctx.settings, scale.len()) else { return Vec::new() };
        let Some(bound) = self.bounds(plan).get_mut(at) else { return Vec::new() };
        if outcome.proposal >= bound.since {
            bound.take(outcome, ctx.settings, (scale.top(), ctx.seq));
        }
        Vec::new()
    }

    fn adopt(&mut self, afresh: &[&str], ctx: &Context<'_>) {
        self.tasks.retain(|task, _| ctx.settings.task(task).is_some() && !afresh.contains(&task.as_str()));
    }

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        settings.tasks.iter().map(|plan| self.status_of(plan)).collect()
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        let rules = vec![
            "Tasks by their weight, each at least 5 %.".to_owned(),
            format!(
                "Of the proposals {} have one param at its bound, on a contested scenario, and the others within theirs; the rest \
                 has all of them within.",
                format_args!("{:.0} %", 100.0 * settings.tuning.number(&BOUNDARY))
            ),
            "A full buffer of such scenarios widens, narrows or keeps the bound. One that lost more than 10 % of its episodes does \
             not count."
                .to_owned(),
        ];
        let summary = "Each param is drawn between its easiest value and a bound that moves with what the agent can do.";
        Explanation::of(settings, VERSION, (summary, rules), |plan| self.now(plan))
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

impl Adr {
    fn known(&self, plan: &TaskPlan) -> Vec<Bound> {
        let fresh = || vec![Bound::default(); Scale::of(plan).len()];
        self.tasks.get(&plan.task).cloned().unwrap_or_else(fresh)
    }

    /// Where a task stands: its params are those at the bounds.
    fn status_of(&self, plan: &TaskPlan) -> TaskStatus {
        let (scale, bounds) = (Scale::of(plan), self.known(plan));
        let places: Vec<f64> = bounds.iter().map(|bound| bound.place).collect();
        let warnings = bounds.iter().zip(scale.names()).flat_map(|(bound, name)| {
            loss_warnings("buffer", &format!(" of {name} at its bound"), &bound.discarded, &bound.filling)
        });
        TaskStatus {
            discarded: bounds.iter().map(|bound| bound.discarded.count).sum(),
            warnings: warnings.collect(),
            rests_on: bounds.iter().filter_map(|bound| bound.filling.rests_on()).min(),
            ..TaskStatus::unmoved(&plan.task, scale.params(&places))
        }
    }

    fn now(&self, plan: &TaskPlan) -> String {
        let scale = Scale::of(plan);
        let of = |(bound, name): (Bound, &str)| {
            let last = bound.last.map_or_else(String::new, |mean| format!(", last {mean:.2}"));
            format!("{name} to row {:.1} of {} ({} moves{last})", bound.place, plan.top(), bound.moves)
        };
        self.known(plan).into_iter().zip(scale.names()).map(of).collect::<Vec<_>>().join(", ")
    }
}
