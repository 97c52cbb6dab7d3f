//! Settings of a run, complete, as stored.

use std::collections::BTreeMap;

use api_types::{EvidenceFrom, Judge, SuccessSetting};
use curriculum::Settings;
use env_core::SuccessRule;
use serde::{Deserialize, Serialize};

use crate::designs::DesignSettings;
use crate::runs::retention_settings::Retention;

/// Maximum number of episodes in a group.
pub const MAX_GROUP_SIZE: u32 = 1024;
/// Default number of groups of a lease of columns that are audited.
pub(crate) const DEFAULT_AUDIT_GROUPS: u32 = 64;
/// Maximum number of groups of a lease of columns that are audited.
pub(crate) const MAX_AUDIT_GROUPS: u32 = 1024;
/// Default score threshold of the raw success rule.
const DEFAULT_RAW_THRESHOLD: f64 = 0.7;

/// A run's settings, complete, as stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunSettings {
    /// Settings of the curriculum.
    pub curriculum: Settings,
    /// Episodes of one scenario in a group.
    pub group_size: u32,
    /// Finished episodes from which a partial group counts.
    pub min_group: u32,
    /// Results older than this many policy versions move nothing.
    pub max_staleness: Option<u32>,
    /// Leases whose outcomes move mastery.
    pub evidence_from: EvidenceFrom,
    /// Rule that decides whether an episode is a success.
    pub success: SuccessSetting,
    /// Thresholds of the raw rule that are not 0.7, by task.
    pub thresholds: BTreeMap<String, f64>,
    /// Layouts designed for the agent's failures.
    pub design: DesignSettings,
    /// Groups of a lease of columns whose logs are replayed.
    pub audit_groups: u32,
    /// Judge of the steps in sessions; `None` uses the server's setting.
    pub judge: Option<Judge>,
    /// Episodes that are kept whole.
    pub retention: Retention,
}

impl RunSettings {
    /// Returns the success rule of a task.
    #[must_use]
    pub fn rule(&self, task: &str) -> SuccessRule {
        match self.success {
            SuccessSetting::Task => SuccessRule::Task,
            SuccessSetting::Raw => {
                SuccessRule::Raw(self.thresholds.get(task).copied().unwrap_or(DEFAULT_RAW_THRESHOLD))
            }
        }
    }

    /// Returns true if results have another meaning under other settings of the same run: the rule of success, the leases that count
    /// or the age of results that count differ. Evidence of both must not be mixed.
    #[must_use]
    pub fn has_other_evidence(&self, other: &Self) -> bool {
        self.success != other.success
            || self.thresholds != other.thresholds
            || self.evidence_from != other.evidence_from
            || self.max_staleness != other.max_staleness
    }

    /// Returns the number of finished episodes from which a group of this size counts: the run's own, or half of the size if a
    /// lease overrides the group size.
    #[must_use]
    pub fn min_group_for(&self, group_size: u32) -> u32 {
        if group_size == self.group_size { self.min_group } else { group_size.div_ceil(2) }
    }
}
