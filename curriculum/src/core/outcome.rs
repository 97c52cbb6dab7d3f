//! Outcomes of groups, as the curriculum receives them.

use serde::{Deserialize, Serialize};

use super::evidence::interval::SuccessInterval;
use super::proposal::{Proposal, ProposalRole, ScenarioSource};
use super::slot::{SlotKey, is_zero};

/// Result of the episodes of one scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupOutcome {
    /// Seq of the proposal.
    pub proposal: u64,
    /// Number of the group in a lease of columns. It is 0 in a lease of groups, which has one group for a proposal.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub group: u32,
    /// Task of the proposal.
    pub task: String,
    /// Level of the proposal.
    pub level: Option<u32>,
    /// Start rung of the proposal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_rung: Option<u32>,
    /// Chain of the staircase that chose the rung.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chain: Option<u32>,
    /// Epoch of the proposal.
    pub epoch: u32,
    /// Role of the proposal.
    pub role: ProposalRole,
    /// True if the scenario's bracket shows that it is contested, whatever the proposal asked for.
    pub contested: bool,
    /// Number of episodes with a result that counts: finished, replayed, and not of too old a policy version.
    pub finished: u32,
    /// Number of successes among them.
    pub successes: u32,
    /// Number of steps of these episodes together.
    #[serde(default)]
    pub steps: u64,
    /// Value of the group's slot; `None` if the group is no slot. Late results and evaluations never become outcomes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<SuccessInterval>,
    /// True if strategies may choose the next scenarios by this outcome: enough episodes finished, and the purpose of
    /// the lease counts. Missing episodes are then left out. This is no evidence of mastery.
    pub usable: bool,
    /// Mean score of the finished episodes.
    pub mean_score: f64,
    /// Mean skill of the finished episodes; `None` if the scenario defines no skill.
    pub mean_skill: Option<f64>,
    /// Origin of the proposal's scenario.
    #[serde(default, skip_serializing_if = "ScenarioSource::is_fresh")]
    pub source: ScenarioSource,
    /// True if a designed layout replaced the scenario of the proposal.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_designed: bool,
    /// Params of the proposal if it has no level that implies them; otherwise empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub params: Vec<(String, f64)>,
    /// Further measurements of the group.
    #[serde(default, skip_serializing_if = "LearningSignals::is_empty")]
    pub signals: LearningSignals,
}

impl GroupOutcome {
    /// Outcome of a slot without any result.
    #[must_use]
    pub fn missing(seq: u64, group: u32, proposal: &Proposal) -> Self {
        Self {
            proposal: seq,
            group,
            task: proposal.task.clone(),
            level: proposal.level,
            start_rung: proposal.start_rung,
            chain: proposal.chain,
            epoch: proposal.epoch,
            role: proposal.role,
            contested: true,
            finished: 0,
            successes: 0,
            steps: 0,
            evidence: Some(SuccessInterval::MISSING),
            usable: false,
            mean_score: 0.0,
            mean_skill: None,
            source: proposal.source.clone(),
            is_designed: false,
            params: if proposal.level.is_none() { proposal.params.clone() } else { Vec::new() },
            signals: LearningSignals::default(),
        }
    }

    /// Share of finished episodes that succeeded; `None` if no episode finished. The strategies that sample use it:
    /// they leave missing episodes out, because they claim no mastery.
    #[must_use]
    pub fn success_rate(&self) -> Option<f64> {
        (self.finished > 0).then(|| f64::from(self.successes.min(self.finished)) / f64::from(self.finished))
    }

    /// Seq of the proposal that first made this scenario.
    #[must_use]
    pub const fn scenario_proposal(&self) -> u64 {
        match self.source {
            ScenarioSource::Replay { of } => of,
            _ => self.proposal,
        }
    }

    /// Learnability of the scenario as this group shows it; see [`learnability`].
    #[must_use]
    pub fn learnability(&self) -> Option<f64> {
        learnability(self.successes.min(self.finished), self.finished)
    }

    /// Key of the group's slot.
    #[must_use]
    pub const fn slot_key(&self) -> SlotKey {
        SlotKey { proposal: self.proposal, group: self.group }
    }
}

/// Estimates k(L − k)/(L(L − 1)) from k successes in L episodes: an unbiased estimate of p(1 − p), which is highest
/// where success is neither certain nor hopeless (Rutherford et al. 2024). `None` for fewer than two episodes.
pub(crate) fn learnability(successes: u32, episodes: u32) -> Option<f64> {
    let (k, n) = (f64::from(successes), f64::from(episodes));
    (episodes > 1).then(|| k * (n - k) / (n * (n - 1.0)))
}

/// Measurements beside success that show how much a scenario can teach.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct LearningSignals {
    /// Mean over the finished episodes of max(0, reference − score)/(reference − floor): the shortfall from the
    /// planner, a lower bound on regret. `None` if reference and floor are equal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regret: Option<f64>,
    /// Share of blind plans that succeed, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel: Option<f64>,
    /// Mean positive value loss, as the trainer reports it (Jiang et al. 2021).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub positive_value_loss: Option<f64>,
    /// Mean MaxMC regret, as the trainer reports it (Jiang et al. 2021b).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_mc: Option<f64>,
}

impl LearningSignals {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
