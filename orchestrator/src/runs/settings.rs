//! What a run is told, as it is sent, checked and stored.

use std::collections::BTreeMap;

use env_core::SuccessRule;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::engine::error::ServiceError;
use crate::designs::{DesignSettings, DesignSettingsRequest};
use crate::judging::Judge;
use curriculum::{Settings, StrategyKind, Target, TaskPlan, Hyperparameters};

/// Most episodes of a group.
pub const MAX_GROUP_SIZE: u32 = 1024;
/// Groups of a lease of columns that are audited where a run does not say, and at most.
const AUDIT_GROUPS: u32 = 64;
pub(crate) const MAX_AUDIT_GROUPS: u32 = 1024;

const fn audit_groups() -> u32 {
    AUDIT_GROUPS
}

/// The usual threshold of the raw rule.
const RAW_THRESHOLD: f64 = 0.7;

/// How many episodes are kept whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum Keep {
    /// At most so many, the newest.
    Most(u32),
    /// `all`: each.
    All(All),
}

/// The word for that.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum All {
    /// `all`.
    All,
}

impl<'de> Deserialize<'de> for Keep {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Read;

        impl serde::de::Visitor<'_> for Read {
            type Value = Keep;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "a whole number from 0 to {}, or \"all\"", u32::MAX)
            }

            fn visit_u64<E: serde::de::Error>(self, number: u64) -> Result<Keep, E> {
                u32::try_from(number)
                    .map(Keep::Most)
                    .map_err(|_| E::invalid_value(serde::de::Unexpected::Unsigned(number), &self))
            }

            fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<Keep, E> {
                if word == "all" {
                    Ok(Keep::All(All::All))
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Str(word), &self))
                }
            }
        }

        deserializer.deserialize_any(Read)
    }
}

impl Keep {
    /// As a number.
    #[must_use]
    pub fn limit(self) -> i64 {
        match self {
            Self::Most(most) => i64::from(most),
            Self::All(_) => i64::MAX,
        }
    }
}

/// What a run keeps whole. Of what is older it keeps how each episode came out; its actions and scenario only where a level
/// move, a layout or an example of a failure rests on them. What was leased for evaluation is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Retention {
    /// The newest episodes of leases of groups.
    pub episodes: Keep,
    /// The newest episodes of leases of columns.
    pub claimed: Keep,
}

impl Default for Retention {
    fn default() -> Self {
        Self { episodes: Keep::Most(50_000), claimed: Keep::Most(10_000_000) }
    }
}

impl Retention {
    /// What was stored before there was any.
    const fn everything() -> Self {
        Self { episodes: Keep::All(All::All), claimed: Keep::All(All::All) }
    }

    /// These, with what a wish says.
    #[must_use]
    pub fn with(self, wish: RetentionRequest) -> Self {
        Self {
            episodes: wish.episodes.unwrap_or(self.episodes),
            claimed: wish.claimed.unwrap_or(self.claimed),
        }
    }
}

/// What a run should keep whole: a number of episodes, or `all`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RetentionRequest {
    /// The newest episodes of leases of groups (50 000).
    pub episodes: Option<Keep>,
    /// The newest episodes of leases of columns (10 000 000).
    pub claimed: Option<Keep>,
}

/// Which leases' outcomes move mastery.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EvidenceFrom {
    /// Those for training.
    Train,
    /// Only probes: episodes the trainer flies without exploring and does not learn from.
    Probe,
}

/// When an episode is a success.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SuccessSetting {
    /// By the task's own rule, against floor and reference.
    Task,
    /// By a threshold on the raw score.
    Raw,
}

/// A table of levels as it is sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LevelTable {
    /// Names of params.
    pub columns: Vec<String>,
    /// One row a level, easy to hard.
    pub rows: Vec<Vec<f64>>,
}

/// What is special about one task of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TaskRequest {
    /// Its share against the others' (1); each task gets at least 5 %.
    pub weight: Option<f64>,
    /// The score that is a success under `success: raw` (0.7).
    pub success_threshold: Option<f64>,
    /// A table of its own instead of the world's.
    pub levels: Option<LevelTable>,
    /// The physics it is flown by at every level, as `physics` in a scenario: options by name, those left out at their
    /// defaults. `GET /v1/tasks` lists them.
    #[schema(example = json!({"contact": "swept", "warnings": "exact"}))]
    pub physics: Option<BTreeMap<String, String>>,
}

/// A run as it is asked for. Everything may be left out.
#[derive(Debug, Clone, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RunRequest {
    /// An id of your choice: 1 to 64 of a-z, 0-9, - and _. Else one is made up.
    pub id: Option<String>,
    /// A name for people.
    pub name: Option<String>,
    /// The seed of the run's random streams, from 0 to 2^51 − 1. Else one is drawn.
    pub seed: Option<u64>,
    /// How proposals are chosen (ladder).
    #[schema(value_type = Option<String>, example = "ladder")]
    pub strategy: Option<StrategyKind>,
    /// The strategy's own settings, by name; those left out are at their defaults. `GET /v1/strategies` lists them.
    #[schema(schema_with = crate::runs::settings_schema::settings)]
    pub strategy_settings: BTreeMap<String, Value>,
    /// What the ladder climbs by: `mastery`, or `half` (the default when group_size > 1).
    #[schema(value_type = Option<String>, example = "mastery")]
    pub target: Option<Target>,
    /// Whether a new run is placed by bisection over the levels (true).
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
    /// Which leases' outcomes move mastery (train).
    pub evidence_from: Option<EvidenceFrom>,
    /// When an episode is a success (task).
    pub success: Option<SuccessSetting>,
    /// The tasks (those of the first world, kessler). Tasks of several worlds may be mixed where the agent can act in
    /// all of them.
    pub tasks: Option<Vec<String>>,
    /// Layouts designed for the agent's failures, mixed into its training.
    pub design: DesignSettingsRequest,
    /// Groups of a lease of columns whose logs are replayed (64): 1 to 1 024.
    pub audit_groups: Option<u32>,
    /// Who judges the steps of sessions that fly for this run: `off`, `deterministic` or `llm` (what the server is set to).
    #[schema(value_type = Option<String>, example = "off")]
    pub judge: Option<Judge>,
    /// What is kept whole.
    pub retention: RetentionRequest,
    /// What is special about single tasks, by id.
    pub task_settings: BTreeMap<String, TaskRequest>,
}

/// A run's settings, complete, as stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunSettings {
    /// What the curriculum is told.
    pub curriculum: Settings,
    /// Episodes of one scenario in a group.
    pub group_size: u32,
    /// Finished episodes from which a partial group counts.
    pub min_group: u32,
    /// Results older than this many policy versions move nothing.
    pub max_staleness: Option<u32>,
    /// Which leases' outcomes move mastery.
    pub evidence_from: EvidenceFrom,
    /// When an episode is a success.
    pub success: SuccessSetting,
    /// Thresholds of the raw rule that are not 0.7, by task.
    pub thresholds: BTreeMap<String, f64>,
    /// Layouts designed for the agent's failures; a run of before there were any has none.
    #[serde(default)]
    pub design: DesignSettings,
    /// Groups of a lease of columns whose logs are replayed.
    #[serde(default = "audit_groups")]
    pub audit_groups: u32,
    /// Who judges the steps of sessions; none: as the server is set to.
    #[serde(default)]
    pub judge: Option<Judge>,
    /// What is kept whole; a run of before there was a choice keeps everything.
    #[serde(default = "Retention::everything")]
    pub retention: Retention,
}

impl RunSettings {
    /// Checks a wish and fills it up.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read(wish: &RunRequest) -> Result<Self, ServiceError> {
        let group_size = wish.group_size.unwrap_or(1);
        within("group_size", group_size, 1, MAX_GROUP_SIZE)?;
        let min_group = wish.min_group.unwrap_or(group_size.div_ceil(2));
        within("min_group", min_group, 1, group_size)?;
        let usual = || env_core::default_tasks().iter().map(|task| task.id().to_owned()).collect();
        let ids = wish.tasks.clone().unwrap_or_else(usual);
        if ids.len() > 100 {
            return Err(ServiceError::invalid("tasks", "at most 100 are taken"));
        }
        let mut tasks = Vec::with_capacity(ids.len());
        let mut thresholds = BTreeMap::new();
        for (at, id) in ids.iter().enumerate() {
            let mut plan = TaskPlan::standard(id)
                .map_err(|error| ServiceError::invalid(format!("tasks.{at}"), error.reason))?;
            if let Some(special) = wish.task_settings.get(id) {
                plan = specialise(plan, special, &mut thresholds)?;
            }
            tasks.push(plan);
        }
        if let Some(id) = wish.task_settings.keys().find(|id| !ids.contains(id)) {
            let id: String = id.chars().take(60).collect();
            return Err(ServiceError::invalid(
                format!("task_settings.{id}"),
                "it is none of the run's tasks",
            ));
        }
        let strategy = wish.strategy.unwrap_or(StrategyKind::Ladder);
        let curriculum = Settings {
            strategy,
            hyperparameters: Hyperparameters::parse(strategy, &wish.strategy_settings)?,
            target: wish.target.unwrap_or_else(|| Target::default_for_group_size(group_size)),
            placement: wish.placement.unwrap_or(true),
            contested_share: wish.contested_share.unwrap_or(0.5),
            frontier_share: wish.frontier_share.unwrap_or(0.7),
            tasks,
        };
        curriculum.validate()?;
        Ok(Self {
            curriculum,
            group_size,
            min_group,
            max_staleness: wish.max_staleness,
            evidence_from: wish.evidence_from.unwrap_or(EvidenceFrom::Train),
            success: wish.success.unwrap_or(SuccessSetting::Task),
            thresholds,
            design: DesignSettings::read(&wish.design)?,
            audit_groups: {
                let groups = wish.audit_groups.unwrap_or(AUDIT_GROUPS);
                within("audit_groups", groups, 1, MAX_AUDIT_GROUPS)?;
                groups
            },
            judge: wish.judge,
            retention: Retention::default().with(wish.retention),
        })
    }

    /// When an episode of this task is a success.
    #[must_use]
    pub fn rule(&self, task: &str) -> SuccessRule {
        match self.success {
            SuccessSetting::Task => SuccessRule::Task,
            SuccessSetting::Raw => {
                SuccessRule::Raw(self.thresholds.get(task).copied().unwrap_or(RAW_THRESHOLD))
            }
        }
    }

    /// Finished episodes from which a group of this size counts: the run's own, or half where a lease overrides the
    /// group size.
    #[must_use]
    pub fn enough(&self, group_size: u32) -> u32 {
        if group_size == self.group_size { self.min_group } else { group_size.div_ceil(2) }
    }
}

pub(crate) fn specialise(
    mut plan: TaskPlan,
    special: &TaskRequest,
    thresholds: &mut BTreeMap<String, f64>,
) -> Result<TaskPlan, ServiceError> {
    let task = plan.task.clone();
    let field = |name: &str| format!("task_settings.{task}.{name}");
    if let Some(threshold) = special.success_threshold {
        if !threshold.is_finite() {
            return Err(ServiceError::invalid(field("success_threshold"), "it must be a finite number"));
        }
        thresholds.insert(plan.task.clone(), threshold);
    }
    if let Some(table) = &special.levels
        && let Some(spec) = env_core::task(&plan.task)
    {
        plan.levels = env_core::space::Levels::new(spec.params(), table.columns.clone(), table.rows.clone())
            .map_err(|error| ServiceError::invalid(field("levels"), error.to_string()))?;
    }
    plan.weight = special.weight.unwrap_or(plan.weight);
    match &special.physics {
        Some(options) => Ok(plan.with_physics(&field("physics"), options)?),
        None => Ok(plan),
    }
}

/// Checks a whole number against its bounds.
pub(crate) fn within(field: &str, value: u32, min: u32, max: u32) -> Result<(), ServiceError> {
    if (min..=max).contains(&value) {
        Ok(())
    } else {
        Err(ServiceError::invalid(field, format!("it is {value}, outside {min} to {max}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_before_there_were_designs_read_and_design_nothing() {
        let settings = RunSettings::read(&RunRequest::default()).expect("the defaults can be");
        assert!(settings.design.on(), "a new run has designs");
        let mut stored = serde_json::to_value(&settings).expect("settings have a JSON form");
        assert_eq!(serde_json::from_value::<RunSettings>(stored.clone()).ok(), Some(settings));
        stored.as_object_mut().and_then(|fields| fields.remove("design")).expect("it was there");
        let old: RunSettings = serde_json::from_value(stored).expect("old settings read");
        assert!(!old.design.on(), "an old run goes on as it was");
    }
}
