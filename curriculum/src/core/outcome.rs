//! Outcomes of groups, as the curriculum receives them.

use serde::{Deserialize, Serialize};

use super::proposal::{ProposalRole, ScenarioSource};

/// Result of the episodes of one scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupOutcome {
    /// Seq of the proposal; for a designed group, of the outcome itself.
    pub proposal: u64,
    /// Task of the proposal.
    pub task: String,
    /// Level of the proposal.
    pub level: Option<u32>,
    /// Epoch of the proposal.
    pub epoch: u32,
    /// Role of the proposal.
    pub role: ProposalRole,
    /// True if the scenario's bracket shows that it is contested, whatever the proposal asked for.
    pub contested: bool,
    /// Number of episodes that finished.
    pub finished: u32,
    /// Number of finished episodes that succeeded.
    pub successes: u32,
    /// Number of episodes lost to infrastructure; they never count as a low score.
    pub failed: u32,
    /// Number of episodes without a result when the lease ended; they never count as a low score.
    pub expired: u32,
    /// True if the outcome may move a level. False for an old policy version, for a training lease while evidence
    /// comes from probes, and for columns of which too many episodes failed. Late results, evaluations and unaudited
    /// claims never become outcomes. Lost episodes do not make it false: a group that failed as a whole is still
    /// evidence that episodes are being lost.
    pub evidence: bool,
    /// Mean score of the finished episodes.
    pub mean_score: f64,
    /// Mean skill of the finished episodes; `None` if the scenario defines no skill.
    pub mean_skill: Option<f64>,
    /// Origin of the proposal's scenario.
    #[serde(default, skip_serializing_if = "ScenarioSource::is_fresh")]
    pub source: ScenarioSource,
    /// Params of the proposal if it has no level that implies them; otherwise empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub params: Vec<(String, f64)>,
    /// Further measurements of the group.
    #[serde(default, skip_serializing_if = "LearningSignals::is_empty")]
    pub signals: LearningSignals,
}

impl GroupOutcome {
    /// Share of finished episodes that succeeded; `None` if no episode finished.
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

    /// Number of episodes that ended without a score.
    #[must_use]
    pub const fn lost_episodes(&self) -> u32 {
        self.failed.saturating_add(self.expired)
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
