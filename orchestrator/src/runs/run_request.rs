//! Settings of a new run, from the request that creates it.

use std::collections::BTreeMap;

use api_types::{EvidenceFrom, RunRequest, SuccessSetting};
use curriculum::{Hyperparameters, Settings, StrategyKind, Target};

use crate::designs::DesignSettings;
use crate::engine::error::ServiceError;
use crate::runs::retention_settings::Retention;
use crate::runs::settings::{DEFAULT_AUDIT_GROUPS, RunSettings};
use crate::runs::settings_update::{SettingsUpdate, standard_plans};

/// Maximum number of tasks in a request.
const MAX_TASKS: usize = 100;

impl TryFrom<&RunRequest> for RunSettings {
    type Error = ServiceError;

    /// Checks a request and returns complete settings. The error names the first invalid field.
    fn try_from(request: &RunRequest) -> Result<Self, ServiceError> {
        if request.tasks.as_ref().is_some_and(|tasks| tasks.len() > MAX_TASKS) {
            return Err(ServiceError::invalid("tasks", format!("must have at most {MAX_TASKS} entries")));
        }
        let update = SettingsUpdate {
            strategy: request.strategy,
            strategy_settings: &request.strategy_settings,
            target: request.target,
            placement: request.placement,
            contested_share: request.contested_share,
            frontier_share: request.frontier_share,
            group_size: request.group_size,
            min_group: request.min_group,
            max_staleness: request.max_staleness,
            evidence_from: request.evidence_from,
            audit_groups: request.audit_groups,
            tasks: request.tasks.as_deref(),
            task_settings: &request.task_settings,
        };
        Ok(Self {
            success: request.success.unwrap_or(SuccessSetting::Task),
            design: DesignSettings::from_request(&request.design)?,
            judge: request.judge,
            retention: Retention::default().with(request.retention),
            ..update.apply(&default_settings(request.group_size.unwrap_or(1))?)?
        })
    }
}

/// Returns the settings of a run whose request leaves everything out. The default target follows from the group size.
fn default_settings(group_size: u32) -> Result<RunSettings, ServiceError> {
    let strategy = StrategyKind::Auto;
    let curriculum = Settings {
        strategy,
        hyperparameters: Hyperparameters::parse(strategy, &BTreeMap::new())?,
        target: Target::default_for_group_size(group_size),
        placement: true,
        contested_share: 0.5,
        frontier_share: 0.7,
        tasks: standard_plans(env_core::default_tasks().iter().map(|task| task.id()))?,
    };
    Ok(RunSettings {
        curriculum,
        group_size: 1,
        min_group: 1,
        max_staleness: None,
        evidence_from: EvidenceFrom::Train,
        success: SuccessSetting::Task,
        thresholds: BTreeMap::new(),
        design: DesignSettings::default(),
        audit_groups: DEFAULT_AUDIT_GROUPS,
        judge: None,
        retention: Retention::default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_settings_have_designs_and_are_read_back() {
        let settings = RunSettings::try_from(&RunRequest::default()).expect("the defaults are valid");
        assert!(settings.design.is_enabled());
        let stored = serde_json::to_value(&settings).expect("settings have a JSON form");
        assert_eq!(serde_json::from_value::<RunSettings>(stored).ok(), Some(settings));
    }
}
