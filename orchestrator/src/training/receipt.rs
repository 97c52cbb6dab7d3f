//! What trainers are told of each result.

use super::audit::Verdict;

/// What became of one reported episode.
#[derive(Debug, Clone, PartialEq, serde::Serialize, utoipa::ToSchema)]
pub struct Receipt {
    /// The episode, as it was written.
    pub episode: String,
    /// `counted` (its group can move the curriculum: mastery, or what the strategy keeps), `stored` (kept as a statistic: an evaluation, a designed
    /// layout, or too old a policy), `audited` (as its columns claim; it counts once all that is audited is),
    /// `failed`, `late` (its lease was over), `duplicate` (reported before, the same), `refused`.
    pub status: &'static str,
    /// Why it was refused: `bad_id`, `unknown_episode`, `foreign_episode`, `invalid_result` (its fields), `invalid_log`,
    /// `conflict`, `other_version` (an evaluation is of one), `expired` (past what the run keeps whole, and never reported), `not_as_claimed` (its columns said otherwise, and are refused).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub code: Option<&'static str>,
    /// The same for people.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
    /// The score, by replay.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
    /// The skill, where the scenario defines one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skill: Option<f64>,
    /// Whether it is a success, by the run's rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub success: Option<bool>,
}

impl Receipt {
    pub(super) fn refused(episode: String, code: &'static str, detail: String) -> Self {
        Self {
            episode,
            status: "refused",
            code: Some(code),
            detail: Some(detail),
            score: None,
            skill: None,
            success: None,
        }
    }

    /// Of a verdict that needs nothing else.
    pub(super) fn without(episode: String, verdict: Verdict) -> Self {
        match verdict {
            Verdict::Refused { code, detail } => Self::refused(episode, code, detail),
            Verdict::Known { score, skill, success } => {
                Self { episode, status: "duplicate", code: None, detail: None, score, skill, success }
            }
            Verdict::Flown { .. } | Verdict::Failed(_) => {
                Self::refused(episode, "unknown_episode", "it has no place".to_owned())
            }
        }
    }
}
