//! Proposals: the scenarios that trainers run next.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::settings::TaskPlan;

/// Purpose of a proposal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProposalRole {
    /// Searches for the level at which a new run starts.
    Placement,
    /// Trains at the current level; its contested outcomes fill the blocks that a move rests on.
    Frontier,
    /// Repeats a level below the current one, so that it is not forgotten.
    Rehearsal,
    /// Samples from the whole range, for strategies without a current level.
    Sample,
    /// Draws a new scenario to measure how much it can teach (learnability, plr, accel).
    Explore,
    /// Repeats a scenario that still has something to teach.
    Replay,
    /// Edits such a scenario (accel).
    Edit,
    /// Holds one param at its moving bound (adr).
    Boundary,
    /// Trains at the rung that a sampler chose (auto, staircase, controller, bandit).
    Rung,
    /// Draws from all rungs, so that none is forgotten (auto, staircase, controller).
    Coverage,
}

/// Origin of a proposal's scenario.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "from", rename_all = "snake_case")]
pub enum ScenarioSource {
    /// The scenario is drawn from the proposal's params.
    #[default]
    Fresh,
    /// The scenario of an earlier proposal is repeated.
    Replay {
        /// Seq of the earlier proposal.
        of: u64,
    },
    /// The scenario of an earlier proposal is repeated with a small change.
    Edited {
        /// Seq of the earlier proposal.
        of: u64,
    },
    /// Several scenarios are drawn; the one whose predicted success is nearest one half is used.
    Chosen {
        /// Number of scenarios to draw.
        among: u32,
        /// Logit of success where no blind plan succeeds.
        base: f64,
        /// Added to the logit in proportion to the share of blind plans that succeed.
        panel: f64,
    },
}

impl ScenarioSource {
    /// True if the scenario is drawn from the proposal's params without any selection.
    #[must_use]
    pub const fn is_fresh(&self) -> bool {
        matches!(self, Self::Fresh)
    }

    /// Seq of the earlier proposal whose scenario is repeated or edited.
    #[must_use]
    pub const fn parent_proposal(&self) -> Option<u64> {
        match self {
            Self::Replay { of } | Self::Edited { of } => Some(*of),
            Self::Fresh | Self::Chosen { .. } => None,
        }
    }
}

/// Task, params and scenario source that an agent should face next.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// Id of the task.
    pub task: String,
    /// Row of the task's level table; `None` if the params come from elsewhere (fixed, adr, alp_gmm), or if the start is easier
    /// than that of any level (samplers).
    pub level: Option<u32>,
    /// Start rung, whose `start_scale` is among the params; omitted from JSON if the task has no start rungs, or the strategy does
    /// not use them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_rung: Option<u32>,
    /// Chain of the staircase that chose the rung; omitted from JSON under other strategies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chain: Option<u32>,
    /// Number of moves of the task so far, steps of placement included. An outcome of an old epoch fills no block.
    pub epoch: u32,
    /// Purpose of the proposal.
    pub role: ProposalRole,
    /// True if the scenario must be contested: it is redrawn until it is, or a threat is planted. False if the first
    /// draw is used.
    pub contested: bool,
    /// All params of the scenario, the task's defaults included.
    pub params: Vec<(String, f64)>,
    /// Physics options that differ from their defaults; omitted from JSON if there are none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub physics: BTreeMap<String, String>,
    /// Origin of the scenario; omitted from JSON if it is drawn. For a repeated or edited scenario, level and params
    /// are those of the original draw.
    #[serde(default, skip_serializing_if = "ScenarioSource::is_fresh")]
    pub source: ScenarioSource,
    /// False if the agent should roll out the episodes without learning from them (plr_robust, accel); omitted from
    /// JSON if true.
    #[serde(default = "default_train", skip_serializing_if = "is_true")]
    pub train: bool,
    /// Reason of the proposal in one short sentence.
    pub why: String,
}

const fn default_train() -> bool {
    true
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_true(value: &bool) -> bool {
    *value
}

impl Proposal {
    /// A proposal that draws a new, not necessarily contested scenario at a level, without a reason. Callers
    /// overwrite the fields that differ.
    #[must_use]
    pub fn fresh(plan: &TaskPlan, level: Option<u32>, role: ProposalRole) -> Self {
        Self {
            task: plan.task.clone(),
            level,
            start_rung: None,
            chain: None,
            epoch: 0,
            role,
            contested: false,
            params: plan.params(level),
            physics: plan.physics.clone(),
            source: ScenarioSource::Fresh,
            train: true,
            why: String::new(),
        }
    }

    /// True if both proposals ask for the same scenario and purpose. The reason is ignored: its wording may change
    /// between versions, and a stored run must stay readable.
    #[must_use]
    pub fn is_same_decision(&self, other: &Self) -> bool {
        self.task == other.task
            && self.level == other.level
            && self.start_rung == other.start_rung
            && self.chain == other.chain
            && self.epoch == other.epoch
            && self.role == other.role
            && self.contested == other.contested
            && self.params == other.params
            && self.physics == other.physics
            && self.source == other.source
            && self.train == other.train
    }
}
