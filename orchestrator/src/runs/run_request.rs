//! The request that creates a run, and the settings it asks for.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;
use utoipa::ToSchema;

use crate::designs::{DesignSettings, DesignSettingsRequest};
use crate::engine::error::ServiceError;
use crate::judging::Judge;
use crate::runs::retention_settings::{Retention, RetentionRequest};
use crate::runs::settings::{DEFAULT_AUDIT_GROUPS, EvidenceFrom, RunSettings, SuccessSetting};
use crate::runs::settings_update::{SettingsUpdate, TaskRequest, standard_plans};
use curriculum::{Hyperparameters, Settings, StrategyKind, Target};

/// Maximum number of tasks in a request.
const MAX_TASKS: usize = 100;

/// Request to create a run. Every field may be left out.
#[derive(Debug, Clone, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RunRequest {
    /// An id of your choice: 1 to 64 of a-z, 0-9, - and _. By default the server generates one.
    pub id: Option<String>,
    /// A name for people.
    pub name: Option<String>,
    /// The seed of the run's random streams, from 0 to 2^51 − 1. By default the server draws one.
    pub seed: Option<u64>,
    /// How proposals are chosen (ladder).
    #[schema(value_type = Option<String>, example = "ladder")]
    pub strategy: Option<StrategyKind>,
    /// The strategy's own settings, by name; those left out are at their defaults. `GET /v1/strategies` lists them.
    #[schema(schema_with = api_types::strategy_settings_schema)]
    pub strategy_settings: BTreeMap<String, Value>,
    /// Target of the ladder: `mastery`, or `half` (the default when group_size > 1).
    #[schema(value_type = Option<String>, example = "mastery")]
    pub target: Option<Target>,
    /// True if a new run is placed by bisection over the levels (true).
    pub placement: Option<bool>,
    /// Share of proposals whose scenario must be contested (0.5).
    pub contested_share: Option<f64>,
    /// Share of proposals at the current level (0.7).
    pub frontier_share: Option<f64>,
    /// Episodes of one scenario in a group (1).
    pub group_size: Option<u32>,
    /// Finished episodes from which a partial group counts (half of group_size).
    pub min_group: Option<u32>,
    /// Results older than this many policy versions move nothing (no limit).
    pub max_staleness: Option<u32>,
    /// Leases whose outcomes move mastery (train).
    pub evidence_from: Option<EvidenceFrom>,
    /// Rule that decides whether an episode is a success (task).
    pub success: Option<SuccessSetting>,
    /// The tasks (those of the first world, kessler). Tasks of several worlds may be mixed where the agent can act in
    /// all of them.
    pub tasks: Option<Vec<String>>,
    /// Layouts designed for the agent's failures, mixed into its training.
    pub design: DesignSettingsRequest,
    /// Groups of a lease of columns whose logs are replayed (64): 1 to 1 024.
    pub audit_groups: Option<u32>,
    /// Judge of the steps in sessions of this run: `off`, `deterministic` or `llm` (the server's setting).
    #[schema(value_type = Option<String>, example = "off")]
    pub judge: Option<Judge>,
    /// Episodes that are kept whole.
    pub retention: RetentionRequest,
    /// Settings of single tasks, by task id.
    pub task_settings: BTreeMap<String, TaskRequest>,
}

impl RunRequest {
    /// Checks the request and returns complete settings.
    ///
    /// # Errors
    /// Returns an error that names the first invalid field.
    pub fn settings(&self) -> Result<RunSettings, ServiceError> {
        if self.tasks.as_ref().is_some_and(|tasks| tasks.len() > MAX_TASKS) {
            return Err(ServiceError::invalid("tasks", format!("at most {MAX_TASKS} are taken")));
        }
        let update = SettingsUpdate {
            strategy: self.strategy,
            strategy_settings: &self.strategy_settings,
            target: self.target,
            placement: self.placement,
            contested_share: self.contested_share,
            frontier_share: self.frontier_share,
            group_size: self.group_size,
            min_group: self.min_group,
            max_staleness: self.max_staleness,
            evidence_from: self.evidence_from,
            audit_groups: self.audit_groups,
            tasks: self.tasks.as_deref(),
            task_settings: &self.task_settings,
        };
        Ok(RunSettings {
            success: self.success.unwrap_or(SuccessSetting::Task),
            design: DesignSettings::from_request(&self.design)?,
            judge: self.judge,
            retention: Retention::default().with(self.retention),
            ..update.apply(&self.defaults()?)?
        })
    }

    /// Returns the settings of a run whose request leaves everything out. The default target follows from the group size.
    fn defaults(&self) -> Result<RunSettings, ServiceError> {
        let strategy = StrategyKind::Ladder;
        let curriculum = Settings {
            strategy,
            hyperparameters: Hyperparameters::parse(strategy, &BTreeMap::new())?,
            target: Target::default_for_group_size(self.group_size.unwrap_or(1)),
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_settings_without_designs_design_nothing() {
        let settings = RunRequest::default().settings().expect("the defaults are valid");
        assert!(settings.design.is_enabled(), "a new run has designs");
        let mut stored = serde_json::to_value(&settings).expect("settings have a JSON form");
        assert_eq!(serde_json::from_value::<RunSettings>(stored.clone()).ok(), Some(settings));
        stored.as_object_mut().and_then(|fields| fields.remove("design")).expect("the field is stored");
        let old: RunSettings =
            serde_json::from_value(stored).expect("settings without the field are readable");
        assert!(!old.design.is_enabled(), "an old run designs nothing");
    }
}
