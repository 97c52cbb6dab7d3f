//! Kinds of jobs, with their names.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Kind of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobKind {
    /// Draws the scenarios of proposals.
    Prepare,
    /// Replays reported episodes, and computes brackets.
    Audit,
    /// Criticises episodes that were replayed.
    Critique,
    /// Designs layouts by the procedural designer.
    DesignProcedural,
    /// Designs layouts by a language model.
    DesignLlm,
    /// Rolls out a built-in policy.
    RolloutBuiltIn,
    /// Rolls out a policy file.
    RolloutFile,
    /// Rolls out a language model.
    RolloutChat,
}

/// A word that names no kind of jobs.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the kind of a job must be prepare, audit, critique, design_procedural, design_llm, rollout_built_in, rollout_file or rollout_chat, got `{0}`"
)]
pub struct UnknownJobKind(pub String);

impl JobKind {
    /// All kinds, in the order of their declaration.
    pub const ALL: [Self; 8] = [
        Self::Prepare,
        Self::Audit,
        Self::Critique,
        Self::DesignProcedural,
        Self::DesignLlm,
        Self::RolloutBuiltIn,
        Self::RolloutFile,
        Self::RolloutChat,
    ];

    /// The word for subjects, options and metrics.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Prepare => "prepare",
            Self::Audit => "audit",
            Self::Critique => "critique",
            Self::DesignProcedural => "design_procedural",
            Self::DesignLlm => "design_llm",
            Self::RolloutBuiltIn => "rollout_built_in",
            Self::RolloutFile => "rollout_file",
            Self::RolloutChat => "rollout_chat",
        }
    }

    /// True if jobs of this kind design layouts. Their payloads are in [`design`](crate::design).
    #[must_use]
    pub const fn is_design(self) -> bool {
        matches!(self, Self::DesignProcedural | Self::DesignLlm)
    }

    /// True if jobs of this kind roll out a policy. Their payloads are in the crate `rollout`.
    #[must_use]
    pub const fn is_rollout(self) -> bool {
        matches!(self, Self::RolloutBuiltIn | Self::RolloutFile | Self::RolloutChat)
    }
}

impl fmt::Display for JobKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for JobKind {
    type Err = UnknownJobKind;

    fn from_str(word: &str) -> Result<Self, UnknownJobKind> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.as_str() == word)
            .ok_or_else(|| UnknownJobKind(word.to_owned()))
    }
}
