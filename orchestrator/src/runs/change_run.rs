//! Changing what a run is told, while it goes on.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;
use utoipa::ToSchema;

use crate::runs::create_run::named;
use crate::runs::settings::{specialise, within, EvidenceFrom, MAX_AUDIT_GROUPS, MAX_GROUP_SIZE, RunSettings, TaskRequest};
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use crate::leases::proposal_queue;
use crate::ids::RunId;
use crate::store::runs::{self, RunRow};
use crate::store::to_json;
use curriculum::{Settings, StrategyKind, Target, TaskPlan, Hyperparameters};

/// What is to change of a run; what is left out stays as it is. Tasks keep their level and mastery unless their table or physics
/// change; under another strategy they keep their mastery, and the strategy starts afresh.
#[derive(Debug, Clone, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RunChange {
    /// Its name for people.
    pub name: Option<String>,
    /// How proposals are chosen.
    #[schema(value_type = Option<String>, example = "plr")]
    pub strategy: Option<StrategyKind>,
    /// The strategy's own settings, by name. With another strategy those left out are at their defaults, else they stay.
    #[schema(schema_with = crate::runs::settings_schema::settings)]
    pub strategy_settings: BTreeMap<String, Value>,
    /// What the ladder climbs by.
    #[schema(value_type = Option<String>, example = "mastery")]
    pub target: Option<Target>,
    /// Whether tasks that are new are placed.
    pub placement: Option<bool>,
    /// Share of proposals whose scenario must be contested.
    pub contested_share: Option<f64>,
    /// Share of proposals at the current level.
    pub frontier_share: Option<f64>,
    /// Episodes of one scenario in a group.
    pub group_size: Option<u32>,
    /// Finished episodes from which a partial group counts.
    pub min_group: Option<u32>,
    /// Results older than this many policy versions move nothing.
    pub max_staleness: Option<u32>,
    /// Which leases' outcomes move mastery.
    pub evidence_from: Option<EvidenceFrom>,
    /// Groups of a lease of columns whose logs are replayed.
    pub audit_groups: Option<u32>,
    /// The tasks, all of them: those that are not in it go.
    pub tasks: Option<Vec<String>>,
    /// What is special about single tasks, by id.
    pub task_settings: BTreeMap<String, TaskRequest>,
}

impl RunChange {
    /// The settings as they will be.
    ///
    /// # Errors
    /// The field at fault.
    fn of(&self, now: &RunSettings) -> Result<RunSettings, ServiceError> {
        let group_size = self.group_size.unwrap_or(now.group_size);
        within("group_size", group_size, 1, MAX_GROUP_SIZE)?;
        let usual = if group_size == now.group_size { now.min_group } else { group_size.div_ceil(2) };
        let min_group = self.min_group.unwrap_or(usual);
        within("min_group", min_group, 1, group_size)?;
        let audit_groups = self.audit_groups.unwrap_or(now.audit_groups);
        within("audit_groups", audit_groups, 1, MAX_AUDIT_GROUPS)?;
        let mut thresholds = now.thresholds.clone();
        let tasks = self.tasks(&now.curriculum, &mut thresholds)?;
        thresholds.retain(|task, _| tasks.iter().any(|plan| plan.task == *task));
        let strategy = self.strategy.unwrap_or(now.curriculum.strategy);
        let mut told = match strategy == now.curriculum.strategy {
            true => now.curriculum.hyperparameters.to_json(),
            false => BTreeMap::new(),
        };
        told.extend(self.strategy_settings.clone());
        let curriculum = Settings {
            strategy,
            hyperparameters: Hyperparameters::parse(strategy, &told)?,
            target: self.target.unwrap_or(now.curriculum.target),
            placement: self.placement.unwrap_or(now.curriculum.placement),
            contested_share: self.contested_share.unwrap_or(now.curriculum.contested_share),
            frontier_share: self.frontier_share.unwrap_or(now.curriculum.frontier_share),
            tasks,
        };
        curriculum.validate()?;
        Ok(RunSettings {
            curriculum,
            group_size,
            min_group,
            audit_groups,
            thresholds,
            max_staleness: self.max_staleness.or(now.max_staleness),
            evidence_from: self.evidence_from.unwrap_or(now.evidence_from),
            ..now.clone()
        })
    }

    fn tasks(
        &self,
        now: &Settings,
        thresholds: &mut BTreeMap<String, f64>,
    ) -> Result<Vec<TaskPlan>, ServiceError> {
        let known = || now.tasks.iter().map(|plan| plan.task.clone()).collect();
        let ids: Vec<String> = self.tasks.clone().unwrap_or_else(known);
        if let Some(id) = self.task_settings.keys().find(|id| !ids.contains(id)) {
            let id: String = id.chars().take(60).collect();
            return Err(ServiceError::invalid(
                format!("task_settings.{id}"),
                "it is none of the run's tasks",
            ));
        }
        let plan = |(at, id): (usize, &String)| {
            let plan = match now.task(id) {
                Some(plan) => plan.clone(),
                None => TaskPlan::standard(id)
                    .map_err(|error| ServiceError::invalid(format!("tasks.{at}"), error.reason))?,
            };
            match self.task_settings.get(id) {
                Some(special) => specialise(plan, special, thresholds),
                None => Ok(plan),
            }
        };
        ids.iter().enumerate().map(plan).collect()
    }
}

/// Changes what a run is told: an event of its curriculum.
#[derive(Debug)]
pub struct ChangeRun {
    /// Which.
    pub run: RunId,
    /// What of it.
    pub wish: RunChange,
}

impl Change for ChangeRun {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let (run, now) = (self.run.as_str(), tx.now);
        let RunTx { state: mind, conn, .. } = tx.run(run).await?;
        let settings = self.wish.of(&mind.settings)?;
        if let Some(name) = &self.wish.name {
            runs::set_name(conn, run, named(name)?).await?;
        }
        let changed = settings.curriculum != mind.settings.curriculum;
        if changed {
            runs::keep_first_curriculum(conn, run, &to_json(&mind.settings.curriculum)?).await?;
            mind.change_settings(settings.curriculum.clone(), now)?;
        }
        mind.settings = settings;
        runs::set_settings(conn, run, &to_json(&mind.settings)?, now).await?;
        if changed {
            proposal_queue::rebuild(&mut tx.run(run).await?).await?;
            tx.emit(run, &RunEvent::Run { state: "changed" })?;
        }
        let row = runs::get(&mut tx.conn, run).await?;
        row.ok_or_else(|| ServiceError::UnknownRun(run.to_owned()))
    }
}
