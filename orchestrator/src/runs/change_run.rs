//! Changes the settings of a run that is in progress.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;
use utoipa::ToSchema;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::ids::RunId;
use crate::leases::proposal_queue;
use crate::runs::settings::{EvidenceFrom, RunSettings};
use crate::runs::settings_update::{SettingsUpdate, TaskRequest};
use crate::runs::validate::check_run_name;
use crate::store::runs::{self, RunRow};
use crate::store::to_json;
use curriculum::{StrategyKind, Target};

/// Request to change a run; a field that is left out keeps its value. Tasks keep their level and mastery unless their table or
/// physics change; under another strategy they keep their mastery, and the strategy starts afresh.
#[derive(Debug, Clone, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RunChange {
    /// A name for people.
    pub name: Option<String>,
    /// How proposals are chosen.
    #[schema(value_type = Option<String>, example = "plr")]
    pub strategy: Option<StrategyKind>,
    /// The strategy's own settings, by name. With another strategy those left out are at their defaults, else they stay.
    #[schema(schema_with = api_types::strategy_settings_schema)]
    pub strategy_settings: BTreeMap<String, Value>,
    /// Target of the ladder: `mastery` or `half`.
    #[schema(value_type = Option<String>, example = "mastery")]
    pub target: Option<Target>,
    /// True if new tasks are placed by bisection over the levels.
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
    /// Leases whose outcomes move mastery.
    pub evidence_from: Option<EvidenceFrom>,
    /// Groups of a lease of columns whose logs are replayed.
    pub audit_groups: Option<u32>,
    /// Ids of all tasks: a task of the run that is not among them is removed.
    pub tasks: Option<Vec<String>>,
    /// Settings of single tasks, by task id.
    pub task_settings: BTreeMap<String, TaskRequest>,
}

impl RunChange {
    /// Returns the settings after the change.
    ///
    /// # Errors
    /// Returns an error that names the first invalid field.
    fn apply_to(&self, settings: &RunSettings) -> Result<RunSettings, ServiceError> {
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
        update.apply(settings)
    }
}

/// Changes the settings of a run, which is an event of its curriculum.
#[derive(Debug)]
pub struct ChangeRun {
    /// Id of the run.
    pub run: RunId,
    /// Settings to change, and their values.
    pub change: RunChange,
}

impl Change for ChangeRun {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let id = self.run.as_str();
        let mut run = tx.run(id).await?;
        let settings = self.change.apply_to(&run.state.settings)?;
        if let Some(name) = &self.change.name {
            check_run_name(name)?;
            runs::set_name(run.conn, id, name).await?;
        }
        let curriculum_changed = settings.curriculum != run.state.settings.curriculum;
        if curriculum_changed {
            runs::keep_first_curriculum(run.conn, id, &to_json(&run.state.settings.curriculum)?).await?;
            run.state.change_settings(settings.curriculum.clone(), run.now)?;
        }
        run.state.settings = settings;
        runs::set_settings(run.conn, id, &to_json(&run.state.settings)?, run.now).await?;
        if curriculum_changed {
            proposal_queue::rebuild(&mut run).await?;
            run.emit(&RunEvent::Run { state: "changed" })?;
        }
        let row = runs::get(run.conn, id).await?;
        row.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))
    }
}
