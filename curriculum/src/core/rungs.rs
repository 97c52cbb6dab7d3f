//! Rungs of a task: the steps of difficulty on which samplers place proposals.
//!
//! A task with start rungs has those: each is a value of the param `start_scale`, and the level is drawn uniformly. Any other
//! task has its levels.

use env_core::space::START_SCALE;
use env_core::{KeyedRng, TaskSpec};
use serde::{Deserialize, Serialize};

use super::proposal::{Proposal, ProposalRole};
use super::settings::TaskPlan;

/// Kind of the rungs of a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RungKind {
    /// Start rungs: values of the param `start_scale`.
    Start,
    /// Levels: rows of the task's level table.
    Level,
}

/// Rungs of a task under a plan, counted from 0, the easiest.
#[derive(Clone, Copy)]
pub(crate) struct RungScale<'a> {
    plan: &'a TaskPlan,
    task: Option<&'static dyn TaskSpec>,
    /// Values of `start_scale`; empty if levels are the rungs.
    starts: &'static [f64],
}

impl<'a> RungScale<'a> {
    pub(crate) fn new(plan: &'a TaskPlan) -> Self {
        Self { plan, task: env_core::task(&plan.task), starts: plan.start_rungs() }
    }

    /// Kind of the rungs on which samplers place proposals of the task.
    pub(crate) const fn kind(&self) -> RungKind {
        if self.are_starts() { RungKind::Start } else { RungKind::Level }
    }

    /// Value of `start_scale` at a start rung; `None` at a level, and beyond the top.
    pub(crate) fn start_scale(&self, kind: RungKind, rung: u32) -> Option<f64> {
        let starts = if kind == RungKind::Start { self.starts } else { &[] };
        starts.get(rung as usize).copied()
    }

    /// Number of rungs of a kind. A task with start rungs has levels, too.
    pub(crate) fn count(&self, kind: RungKind) -> u32 {
        match kind {
            RungKind::Start => u32::try_from(self.starts.len()).unwrap_or(u32::MAX),
            RungKind::Level => self.plan.hardest_level().saturating_add(1),
        }
    }

    /// True if the rungs are starts, at levels drawn uniformly.
    pub(crate) const fn are_starts(&self) -> bool {
        !self.starts.is_empty()
    }

    /// Number of the hardest rung.
    pub(crate) fn top(&self) -> u32 {
        self.len().saturating_sub(1)
    }

    /// Number of rungs of the task.
    pub(crate) fn len(&self) -> u32 {
        self.count(self.kind())
    }

    /// True if a blind plan can succeed, so that only contested scenarios show whether acting helps.
    pub(crate) fn can_be_blind(&self) -> bool {
        self.task.is_some_and(TaskSpec::blind_can_succeed)
    }

    /// Largest number of steps of an episode at the default params.
    pub(crate) fn horizon(&self) -> u32 {
        let params = self.plan.default_params.iter().map(|(name, value)| (name.as_str(), *value));
        let recipe = self.task.and_then(|task| env_core::Recipe::with_params(task, params).ok());
        recipe.map_or(1, |recipe| recipe.task().horizon(&recipe))
    }

    /// Rung of a proposal or an outcome with this start rung and level.
    pub(crate) fn rung(&self, start_rung: Option<u32>, level: Option<u32>) -> Option<u32> {
        let rung = if self.are_starts() { start_rung } else { level };
        rung.filter(|rung| *rung <= self.top())
    }

    /// Proposes a fresh scenario at a rung, without a reason. A start that is easier than the task's belongs to no level.
    pub(crate) fn propose(&self, rung: u32, role: ProposalRole, rng: &mut KeyedRng) -> Proposal {
        if !self.are_starts() {
            return Proposal::fresh(self.plan, Some(rung), role);
        }
        let level = rng.below(self.plan.hardest_level() + 1);
        let mut proposal = Proposal::fresh(self.plan, Some(level), role);
        let scale = self.starts.get(rung as usize).copied().unwrap_or(1.0);
        proposal.start_rung = Some(rung);
        proposal.level = Some(level).filter(|_| scale >= 1.0);
        match proposal.params.iter_mut().find(|(name, _)| name == START_SCALE.name) {
            Some((_, value)) => *value = scale,
            None => proposal.params.push((START_SCALE.name.to_owned(), scale)),
        }
        proposal
    }
}

impl TaskPlan {
    /// Values of `start_scale` on the rungs of the task, from the easiest; empty if its levels are the rungs.
    #[must_use]
    pub fn start_rungs(&self) -> &'static [f64] {
        // A plan that scales starts by itself leaves nothing to the rungs.
        let has_own_scale = self.levels.columns().iter().any(|column| column == START_SCALE.name)
            || self.default_params.iter().any(|(name, value)| name == START_SCALE.name && *value != 1.0);
        let task = env_core::task(&self.task).filter(|_| !has_own_scale);
        task.map_or(&[], TaskSpec::start_rungs)
    }
}

impl Proposal {
    /// True if the start is as hard as the task has it. Only such scenarios can show mastery of their level.
    #[must_use]
    pub fn has_full_start(&self) -> bool {
        self.params.iter().all(|(name, value)| name != START_SCALE.name || *value >= 1.0)
    }
}
