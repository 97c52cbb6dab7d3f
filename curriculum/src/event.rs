//! What goes out of the curriculum and what comes back: proposals, outcomes, moves, and the events of the fold.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::settings::TaskPlan;
use super::stored::StoredSettings;

/// What a proposal is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Finds the level at which a new run starts.
    Placement,
    /// The current level: its contested outcomes fill the blocks that a move rests on.
    Frontier,
    /// A level already passed, so that it is not forgotten.
    Rehearsal,
    /// Drawn by a strategy without levels to climb.
    Sample,
    /// A scenario nobody has seen, to find out what it has to teach (learnability, plr, accel).
    Explore,
    /// A scenario again that has something to teach.
    Replay,
    /// An edit of such a scenario (accel).
    Edit,
    /// One param at the bound that it may move (adr).
    Boundary,
}

/// Where a proposal's scenario comes from.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "from", rename_all = "snake_case")]
pub enum Source {
    /// It is drawn.
    #[default]
    Fresh,
    /// It is the scenario of an earlier proposal.
    Again {
        /// That one's seq.
        of: u64,
    },
    /// It is the scenario of an earlier proposal with something changed.
    Edited {
        /// That one's seq.
        of: u64,
    },
    /// It is the one of some that are drawn whose predicted success is nearest one half.
    Chosen {
        /// How many are drawn.
        among: u32,
        /// The logit of success where no blind plan succeeds.
        base: f64,
        /// What is added where all of them do, and in part where some do.
        panel: f64,
    },
}

impl Source {
    /// Whether it is drawn as any other.
    #[must_use]
    pub const fn is_fresh(&self) -> bool {
        matches!(self, Self::Fresh)
    }

    /// The earlier proposal whose scenario is wanted.
    #[must_use]
    pub const fn origin(&self) -> Option<u64> {
        match self {
            Self::Again { of } | Self::Edited { of } => Some(*of),
            Self::Fresh | Self::Chosen { .. } => None,
        }
    }
}

const fn yes() -> bool {
    true
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde asks")]
const fn is_yes(whether: &bool) -> bool {
    *whether
}

/// What an agent should face next.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// The task's id.
    pub task: String,
    /// The row of the task's table; none where the task's default params are used (fixed).
    pub level: Option<u32>,
    /// How many moves, steps of placement included, the task has had. An outcome of an old epoch fills no block.
    pub epoch: u32,
    /// What it is for.
    pub role: Role,
    /// The scenario must be contested: drawn until admitted, planted otherwise. False: as it comes.
    pub contested: bool,
    /// The params, the task's defaults included.
    pub params: Vec<(String, f64)>,
    /// The physics options that are not at their defaults; left out where there are none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub physics: BTreeMap<String, String>,
    /// Where its scenario comes from; left out where it is drawn. Level and params are those at which it, or what it was edited
    /// from, was drawn.
    #[serde(default, skip_serializing_if = "Source::is_fresh")]
    pub source: Source,
    /// False: the agent should fly it and not learn from it (plr_robust, accel); left out where it should.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub train: bool,
    /// A short sentence for people.
    pub why: String,
}

impl Proposal {
    /// Whether two proposals ask for the same thing. The sentence for people is left out: its wording may change
    /// between versions without a stored run becoming unreadable.
    #[must_use]
    pub fn same_decision(&self, other: &Self) -> bool {
        self.task == other.task
            && self.level == other.level
            && self.epoch == other.epoch
            && self.role == other.role
            && self.contested == other.contested
            && self.params == other.params
            && self.physics == other.physics
            && self.source == other.source
            && self.train == other.train
    }

    /// A plain draw at a level of a task, to be filled up.
    #[must_use]
    pub fn at(plan: &TaskPlan, level: Option<u32>, role: Role) -> Self {
        Self {
            task: plan.task.clone(),
            level,
            epoch: 0,
            role,
            contested: false,
            params: plan.params(level),
            physics: plan.physics.clone(),
            source: Source::Fresh,
            train: true,
            why: String::new(),
        }
    }
}

/// How the episodes of one scenario went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupOutcome {
    /// The seq of the proposal.
    pub proposal: u64,
    /// The proposal's task.
    pub task: String,
    /// The proposal's level.
    pub level: Option<u32>,
    /// The proposal's epoch.
    pub epoch: u32,
    /// The proposal's role.
    pub role: Role,
    /// Whether the scenario is contested, as its bracket found, not as was asked.
    pub contested: bool,
    /// Episodes that finished.
    pub finished: u32,
    /// Finished episodes that succeeded.
    pub successes: u32,
    /// Episodes lost to infrastructure: never a low score.
    pub failed: u32,
    /// Episodes whose lease ran out: never a low score.
    pub expired: u32,
    /// False for what may be counted but moves nothing: an old policy version, a late result, an evaluation, an
    /// unaudited report. It does not speak of failed episodes: a group that failed as a whole is still evidence (that
    /// episodes are being lost).
    pub evidence: bool,
    /// Mean score of the finished episodes.
    pub mean_score: f64,
    /// Mean skill of the finished episodes, where the scenario defines one.
    pub mean_skill: Option<f64>,
    /// What the proposal's scenario came from.
    #[serde(default, skip_serializing_if = "Source::is_fresh")]
    pub source: Source,
    /// The proposal's params, where it has no level to say them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub params: Vec<(String, f64)>,
    /// What else is known of how it went.
    #[serde(default, skip_serializing_if = "Signals::are_none")]
    pub signals: Signals,
}

/// What says how much a scenario has to teach, beside success.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Signals {
    /// Mean over the finished episodes of max(0, reference − score)/(reference − floor): how far short of the planner, a lower
    /// bound on regret. None where reference and floor are one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regret: Option<f64>,
    /// The share of blind plans that succeed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel: Option<f64>,
    /// Mean positive value loss, as the trainer reports it (Jiang et al. 2021).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub positive_value_loss: Option<f64>,
    /// Mean MaxMC regret, as the trainer reports it (Jiang et al. 2021b).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_mc: Option<f64>,
}

impl Signals {
    fn are_none(&self) -> bool {
        *self == Self::default()
    }
}

impl GroupOutcome {
    /// The share of finished episodes that succeeded; none where none finished.
    #[must_use]
    pub fn value(&self) -> Option<f64> {
        (self.finished > 0).then(|| f64::from(self.successes.min(self.finished)) / f64::from(self.finished))
    }

    /// The seq of the proposal that made its scenario.
    #[must_use]
    pub const fn made_by(&self) -> u64 {
        match self.source {
            Source::Again { of } => of,
            _ => self.proposal,
        }
    }

    /// k(L − k)/(L(L − 1)) of k successes in L episodes: an unbiased estimate of p(1 − p), how much a scenario tells apart what
    /// works (Rutherford et al. 2024). None of fewer than two episodes.
    #[must_use]
    pub fn learnability(&self) -> Option<f64> {
        learnability(self.successes.min(self.finished), self.finished)
    }

    /// Episodes that ended without a score.
    #[must_use]
    pub const fn lost(&self) -> u32 {
        self.failed.saturating_add(self.expired)
    }
}

/// See [`GroupOutcome::learnability`].
pub(super) fn learnability(successes: u32, episodes: u32) -> Option<f64> {
    let (k, n) = (f64::from(successes), f64::from(episodes));
    (episodes > 1).then(|| k * (n - k) / (n * (n - 1.0)))
}

/// Which way a level went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MoveKind {
    /// Placement ended.
    Placement,
    /// One level up.
    Up,
    /// One level down.
    Down,
}

/// A change of level, with what it rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Move {
    /// The task's id.
    pub task: String,
    /// Which way.
    pub kind: MoveKind,
    /// The level before; none before placement.
    pub from: Option<u32>,
    /// The level now.
    pub to: u32,
    /// Why.
    pub evidence: Evidence,
}

/// What a move rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// For people.
    pub sentence: String,
    /// The full blocks, oldest first; empty for a placement.
    pub blocks: Vec<BlockEvidence>,
    /// The probes of a placement, in order; empty otherwise.
    pub probes: Vec<ProbeEvidence>,
}

impl Evidence {
    /// The seq of the earliest proposal that it rests on; none where that was not noted yet.
    #[must_use]
    pub fn first(&self) -> Option<u64> {
        let firsts =
            self.blocks.iter().map(|block| block.first).chain(self.probes.iter().map(|probe| probe.first));
        firsts.collect::<Option<Vec<_>>>()?.into_iter().min()
    }
}

/// A full block of contested scenarios.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BlockEvidence {
    /// Scenarios.
    pub n: u32,
    /// Sum of their success shares.
    pub sum: f64,
    /// Mean of their success shares.
    pub mean: f64,
    /// 10 % quantile of Beta(1 + sum, 1 + n − sum).
    pub q10: f64,
    /// 90 % quantile of the same.
    pub q90: f64,
    /// Episodes that finished.
    pub finished: u32,
    /// Episodes that failed or expired.
    pub lost: u32,
    /// The seq of its earliest proposal; none in a block of before that was noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<u64>,
}

/// One probed level of a placement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ProbeEvidence {
    /// The level probed.
    pub level: u32,
    /// Scenarios.
    pub n: u32,
    /// Sum of their success shares.
    pub sum: f64,
    /// Mean of their success shares.
    pub mean: f64,
    /// Whether the level passed.
    pub passed: bool,
    /// The seq of its earliest proposal; none in a probe of before that was noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<u64>,
}

/// What is stored, in the order of seq; the curriculum is the fold over it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", content = "data", rename_all = "snake_case")]
pub enum CurriculumEvent {
    /// The curriculum proposed.
    Proposed(Proposal),
    /// The outcome of a group was observed.
    Outcome(GroupOutcome),
    /// The settings changed.
    Settings(StoredSettings),
}
