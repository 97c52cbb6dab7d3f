//! Changes the settings of a run that is in progress.

use api_types::RunUpdate;
use store::ids::RunId;
use store::runs::{self, RunRow};
use store::to_json;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::leases::proposal_queue;
use crate::runs::settings::RunSettings;
use crate::runs::settings_update::SettingsUpdate;
use crate::runs::validate::check_run_name;

/// Changes the settings of a run, which is an event of its curriculum.
#[derive(Debug)]
pub struct ChangeRun {
    /// Id of the run.
    pub run: RunId,
    /// Settings to change, and their values.
    pub change: RunUpdate,
}

impl Change for ChangeRun {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let id = self.run.as_str();
        let mut run = tx.run(id).await?;
        let settings = apply_change(&self.change, &run.state.settings)?;
        if let Some(name) = &self.change.name {
            check_run_name(name)?;
            runs::set_name(run.conn, id, name).await?;
        }
        let curriculum_changed = settings.curriculum != run.state.settings.curriculum;
        if curriculum_changed {
            runs::keep_initial_curriculum(run.conn, id, &to_json(&run.state.settings.curriculum)?).await?;
            run.state.change_settings(settings.curriculum.clone(), run.now)?;
        }
        let evidence_changed = run.state.settings.has_other_evidence(&settings);
        if evidence_changed {
            run.state.restart_evidence(run.now)?;
        }
        run.state.settings = settings;
        runs::set_settings(run.conn, id, &to_json(&run.state.settings)?, run.now).await?;
        if curriculum_changed || evidence_changed {
            proposal_queue::rebuild(&mut run).await?;
            run.emit(&RunEvent::Run { state: "changed" })?;
        }
        let row = runs::get(run.conn, id).await?;
        row.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))
    }
}

/// Returns the settings of a run after a change.
///
/// # Errors
/// Returns an error that names the first invalid field.
fn apply_change(change: &RunUpdate, settings: &RunSettings) -> Result<RunSettings, ServiceError> {
    let update = SettingsUpdate {
        strategy: change.strategy,
        strategy_settings: &change.strategy_settings,
        target: change.target,
        placement: change.placement,
        contested_share: change.contested_share,
        frontier_share: change.frontier_share,
        group_size: change.group_size,
        min_group: change.min_group,
        max_staleness: change.max_staleness,
        evidence_from: change.evidence_from,
        audit_groups: change.audit_groups,
        tasks: change.tasks.as_deref(),
        task_settings: &change.task_settings,
    };
    update.apply(settings)
}
