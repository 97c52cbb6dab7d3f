//! The one place that turns the fields of a request into run settings: those of a new run, or changed ones.

use std::collections::BTreeMap;

use api_types::{EvidenceFrom, TaskSettingsRequest};
use curriculum::{Hyperparameters, Settings, StrategyKind, Target, TaskPlan};
use serde_json::Value;

use crate::engine::error::ServiceError;
use crate::runs::settings::{MAX_AUDIT_GROUPS, MAX_GROUP_SIZE, RunSettings};
use crate::runs::validate::check_range;

/// Maximum number of characters of an unknown task's id that an error repeats.
const MAX_ECHOED_CHARS: usize = 60;

/// Settings that a request sets; a field that is `None` or empty keeps its value.
pub(crate) struct SettingsUpdate<'a> {
    pub(crate) strategy: Option<StrategyKind>,
    /// The strategy's own settings, by name. Those left out keep their values, or get their defaults under another strategy.
    pub(crate) strategy_settings: &'a BTreeMap<String, Value>,
    pub(crate) target: Option<Target>,
    pub(crate) placement: Option<bool>,
    pub(crate) contested_share: Option<f64>,
    pub(crate) frontier_share: Option<f64>,
    pub(crate) group_size: Option<u32>,
    /// Finished episodes from which a partial group counts. If it is left out and the group size changes, half of that.
    pub(crate) min_group: Option<u32>,
    pub(crate) max_staleness: Option<u32>,
    pub(crate) evidence_from: Option<EvidenceFrom>,
    pub(crate) audit_groups: Option<u32>,
    /// Ids of all tasks: a task of the run that is not among them is removed.
    pub(crate) tasks: Option<&'a [String]>,
    /// Settings of single tasks, by task id.
    pub(crate) task_settings: &'a BTreeMap<String, TaskSettingsRequest>,
}

impl SettingsUpdate<'_> {
    /// Returns `base` with the fields that are set.
    ///
    /// # Errors
    /// Returns an error that names the first invalid field.
    pub(crate) fn apply(&self, base: &RunSettings) -> Result<RunSettings, ServiceError> {
        let group_size = self.group_size.unwrap_or(base.group_size);
        check_range("group_size", group_size, 1, MAX_GROUP_SIZE)?;
        let min_group = self.min_group.unwrap_or_else(|| base.min_group_for(group_size));
        check_range("min_group", min_group, 1, group_size)?;
        let audit_groups = self.audit_groups.unwrap_or(base.audit_groups);
        check_range("audit_groups", audit_groups, 1, MAX_AUDIT_GROUPS)?;
        let mut thresholds = base.thresholds.clone();
        let tasks = self.plans(&base.curriculum, &mut thresholds)?;
        thresholds.retain(|task, _| tasks.iter().any(|plan| plan.task == *task));
        let strategy = self.strategy.unwrap_or(base.curriculum.strategy);
        let mut hyperparameters = match strategy == base.curriculum.strategy {
            true => base.curriculum.hyperparameters.to_json(),
            false => BTreeMap::new(),
        };
        hyperparameters.extend(self.strategy_settings.clone());
        let curriculum = Settings {
            strategy,
            hyperparameters: Hyperparameters::parse(strategy, &hyperparameters)?,
            target: self.target.unwrap_or(base.curriculum.target),
            placement: self.placement.unwrap_or(base.curriculum.placement),
            contested_share: self.contested_share.unwrap_or(base.curriculum.contested_share),
            frontier_share: self.frontier_share.unwrap_or(base.curriculum.frontier_share),
            tasks,
        };
        curriculum.validate()?;
        Ok(RunSettings {
            curriculum,
            group_size,
            min_group,
            audit_groups,
            thresholds,
            max_staleness: self.max_staleness.or(base.max_staleness),
            evidence_from: self.evidence_from.unwrap_or(base.evidence_from),
            ..base.clone()
        })
    }

    /// Returns the plans of the tasks, and inserts their success thresholds.
    fn plans(
        &self,
        base: &Settings,
        thresholds: &mut BTreeMap<String, f64>,
    ) -> Result<Vec<TaskPlan>, ServiceError> {
        let ids: Vec<&str> = match self.tasks {
            Some(tasks) => tasks.iter().map(String::as_str).collect(),
            None => base.tasks.iter().map(|plan| plan.task.as_str()).collect(),
        };
        if let Some(id) = self.task_settings.keys().find(|id| !ids.contains(&id.as_str())) {
            let id: String = id.chars().take(MAX_ECHOED_CHARS).collect();
            return Err(ServiceError::invalid(
                format!("task_settings.{id}"),
                "is not a task of the run; add it to `tasks`",
            ));
        }
        let mut plans = Vec::with_capacity(ids.len());
        for (at, id) in ids.into_iter().enumerate() {
            let plan = match base.task(id) {
                Some(plan) => plan.clone(),
                None => standard_plan(at, id)?,
            };
            plans.push(match self.task_settings.get(id) {
                Some(request) => apply_task_request(plan, request, thresholds)?,
                None => plan,
            });
        }
        Ok(plans)
    }
}

/// Returns the standard plans of tasks.
///
/// # Errors
/// Returns an error that names the first unknown task.
pub(crate) fn standard_plans<'a>(ids: impl Iterator<Item = &'a str>) -> Result<Vec<TaskPlan>, ServiceError> {
    ids.enumerate().map(|(at, id)| standard_plan(at, id)).collect()
}

/// Returns the standard plan of the task at this place of the list.
fn standard_plan(at: usize, id: &str) -> Result<TaskPlan, ServiceError> {
    TaskPlan::standard(id).map_err(|error| ServiceError::invalid(format!("tasks.{at}"), error.reason))
}

/// Returns a plan with the settings of a request, and inserts its success threshold.
fn apply_task_request(
    mut plan: TaskPlan,
    request: &TaskSettingsRequest,
    thresholds: &mut BTreeMap<String, f64>,
) -> Result<TaskPlan, ServiceError> {
    let task = plan.task.clone();
    let field = |name: &str| format!("task_settings.{task}.{name}");
    if let Some(threshold) = request.success_threshold {
        if !threshold.is_finite() {
            return Err(ServiceError::invalid(field("success_threshold"), "must be a finite number"));
        }
        thresholds.insert(plan.task.clone(), threshold);
    }
    if let Some(table) = &request.levels
        && let Some(spec) = env_core::task(&plan.task)
    {
        plan.levels = env_core::space::Levels::new(spec.params(), table.columns.clone(), table.rows.clone())
            .map_err(|error| ServiceError::invalid(field(error.field()), error.reason()))?;
    }
    plan.weight = request.weight.unwrap_or(plan.weight);
    match &request.physics {
        Some(options) => Ok(plan.with_physics(&field("physics"), options)?),
        None => Ok(plan),
    }
}
